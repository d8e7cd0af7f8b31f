"""Strips of an image along an outline, straightened: what the edge reader of E sees.

A strip has a row for each sample of one part of the outline (a line, or the tip's arc) and a column
for each place along the sample's normal.
"""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.refinement.contour import LINE_SAMPLES, Array, Contour
from shaftpose.refinement.contour_sampling import profiles

ROWS, COLUMNS = LINE_SAMPLES, 25
MIDDLE = COLUMNS // 2  # the column on the outline
_SCALED = np.arange(256, dtype=np.float32) / np.float32(127.5) - 1


class Strips(NamedTuple):
    """colours: (P, ROWS, COLUMNS, 3) float32 in [-1, 1], 0 in unused rows, one strip for each of
    the P visible parts; used: (P, ROWS) bool; inside: (N,), 1 for samples whose row lies in the
    image, else 0."""

    colours: NDArray[np.float32]
    used: NDArray[np.bool_]
    inside: Array

    def of_samples(self, rows: NDArray[np.float32]) -> Array:
        """Values for the rows, (P, ROWS), as values for the N samples of the contour."""
        return rows[self.used].astype(float)

    def of_rows(self, samples: Array) -> NDArray[np.float32]:
        """Values for the N samples, as values for the rows, (P, ROWS); 0 in unused rows."""
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
    """Grey levels (H, W, 3) -> [-1, 1]."""
    return np.asarray(cv2.LUT(rgb, _SCALED), np.float32)
