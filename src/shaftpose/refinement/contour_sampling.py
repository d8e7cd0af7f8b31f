"""Images sampled along the normals of a contour: profiles, and strips for an edge reader."""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.refinement.contour import LINE_SAMPLES, Array, Contour

ROWS, COLUMNS = LINE_SAMPLES, 25
MIDDLE = COLUMNS // 2  # the column on the outline
_SCALED = np.arange(256, dtype=np.float32) / np.float32(127.5) - 1


def symmetric_steps(reach_px: float, step_px: float) -> Array:
    """Positions along a profile that include 0 and reach from -reach_px to reach_px at least."""
    count = int(np.ceil(reach_px / step_px))
    return step_px * np.arange(-count, count + 1)


def profiles(
    picture: NDArray[np.float32], contour: Contour, steps: Array
) -> tuple[NDArray[np.float32], Array]:
    """Profiles (N, S, ...) of a picture (H, W, ...) along the contour's normals, and whether each
    lies inside the picture and its round field: (N,), 1 or 0.

    steps: (S,) px from the contour, positive outwards.
    """
    at = contour.points[:, None] + steps[:, None] * contour.normals[:, None]
    height, width = picture.shape[:2]
    ends = at[:, [0, -1]]
    inside = np.all((ends >= 0) & (ends <= [width, height]), axis=(1, 2))
    if contour.field is not None:
        inside &= np.all(contour.field.border_px(ends) >= 0, axis=1)
    x, y = np.moveaxis((at - 0.5).astype(np.float32), -1, 0)  # OpenCV's pixel centres: integers
    read = cv2.remap(picture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(read, dtype=np.float32), inside.astype(float)


class Strips(NamedTuple):
    """Straightened strips of an image, one for each of the P visible parts of an outline (a line,
    or the tip's arc).

    A row is a sample of the outline, a column a position along its normal. colours: (P, ROWS,
    COLUMNS, 3) float32 in [-1, 1], 0 in unused rows. used: (P, ROWS) bool. inside: (N,), 1 for
    samples whose row lies in the image, else 0.
    """

    colours: NDArray[np.float32]
    used: NDArray[np.bool_]
    inside: Array

    def of_samples(self, rows: NDArray[np.float32]) -> Array:
        """Values (N,) of the contour's samples from values (P, ROWS) of the rows."""
        return rows[self.used].astype(float)

    def of_rows(self, samples: Array) -> NDArray[np.float32]:
        """Values (P, ROWS) of the rows, 0 in unused ones, from values (N,) of the samples."""
        rows = np.zeros(self.used.shape, np.float32)
        rows[self.used] = samples
        return rows


def outline_strips(rgb: NDArray[np.float32], contour: Contour, step_px: float) -> Strips:
    """Read the strips of an image (H, W, 3) in [-1, 1] with `step_px` between columns."""
    steps = step_px * (np.arange(COLUMNS) - MIDDLE)
    read, inside = profiles(rgb, contour, steps)
    numbers, counts = np.unique(contour.parts, return_counts=True)
    used = np.arange(ROWS) < counts[:, None]
    colours = np.zeros((len(numbers), ROWS, COLUMNS, 3), np.float32)
    colours[used] = read  # the samples of a contour are in the order of its parts
    return Strips(colours, used, inside)


def scaled(rgb: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Scale 8-bit values (H, W, 3) to [-1, 1]."""
    return np.asarray(cv2.LUT(rgb, _SCALED), np.float32)
