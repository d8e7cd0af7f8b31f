"""Where the edges of a picture lie along the normals of a contour."""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.core.contour import Array, Contour

_STEP_PX = 0.5  # between the samples of a profile
_GRADIENT_NOISE = 15.0  # grey levels per px; weaker edges count less
_FARTHEST = 3.0  # edges of an image count up to this many times their reach
# Strongest gradients lie this far inside the outlines of rendered steel, in pixels of an image as
# large as the network's (docs/beyond.md).
INSIDE_PX = 0.05


class Offsets(NamedTuple):
    """px: (N,) distance of the edge from the contour, positive outwards; weights: (N,) in [0, 1],
    how clear and near each edge is."""

    px: Array
    weights: Array


def mask_offsets(mask: NDArray[np.float32], contour: Contour, reach_px: float) -> Offsets:
    """Edges of a soft mask (H, W) in [0, 1], within `reach_px` of the contour.

    The integral over the profile of a step from 1 to 0 is where the step lies, without a threshold.
    """
    steps = _steps(reach_px)
    profiles, inside = _profiles(mask, contour, steps)
    ends = (profiles[:, 0] + profiles[:, -1]) / 2
    offsets = _STEP_PX * (profiles.sum(axis=1) - ends) + steps[0]  # by the trapezoid rule
    contrast = np.clip(profiles[:, 0] - profiles[:, -1], 0.0, 1.0) * inside
    robust = 1 / (1 + (offsets / (0.3 * reach_px)) ** 2)
    return Offsets(offsets, contrast**2 * robust)


def mask_contrast(
    mask: NDArray[np.float32], contour: Contour, reach_px: float
) -> tuple[Array, Array]:
    """How much a soft mask (H, W) falls from `reach_px` inside of a contour to as far outside, (N,)
    in [0, 1], and the lengths (N,) px of the contour for which that lies in the mask, else 0."""
    ends, inside = _profiles(mask, contour, np.array([-reach_px, reach_px]))
    return np.clip(ends[:, 0] - ends[:, 1], 0.0, 1.0).astype(float), contour.lengths * inside


class Gradients(NamedTuple):
    """Of an image, by x and y, each (H, W, 3) in grey levels per px."""

    by_x: NDArray[np.float32]
    by_y: NDArray[np.float32]


def image_gradients(rgb: NDArray[np.uint8]) -> Gradients:
    """The gradients of an image (H, W, 3)."""
    smooth = cv2.GaussianBlur(rgb.astype(np.float32), (0, 0), 0.7)
    return Gradients(
        np.asarray(cv2.Scharr(smooth, cv2.CV_32F, 1, 0, scale=1 / 32), np.float32),
        np.asarray(cv2.Scharr(smooth, cv2.CV_32F, 0, 1, scale=1 / 32), np.float32),
    )


def image_offsets(
    gradients: Gradients,
    contour: Contour,
    reach_px: float,
    inside_px: float = INSIDE_PX,
) -> Offsets:
    """Edges of an image: along each normal the local maximum of the gradient that is strongest if
    weighted by its nearness, moved outwards by `inside_px`. Reliable only from a start within a px:
    metal has strong edges of its own."""
    steps = _steps(_FARTHEST * reach_px)
    (by_x, inside), (by_y, _) = (_profiles(part, contour, steps) for part in gradients)
    normals = contour.normals[:, None, None]
    strength = np.linalg.norm(by_x * normals[..., 0] + by_y * normals[..., 1], axis=-1)
    before, middle, after = strength[:, :-2], strength[:, 1:-1], strength[:, 2:]
    nearness = np.exp(-(steps[1:-1] ** 2) / (2 * reach_px**2))
    peaks = np.where((middle >= before) & (middle > after), middle * nearness, 0.0)
    best = peaks.argmax(axis=1)
    rows = np.arange(len(best))
    low, peak, high = before[rows, best], middle[rows, best], after[rows, best]
    found = (peaks[rows, best] > 0) * inside
    bend = np.minimum(low - 2 * peak + high, -1e-6)
    offsets = steps[1:-1][best] + _STEP_PX * 0.5 * (low - high) / bend
    robust = 1 / (1 + (offsets / (0.7 * reach_px + 0.15)) ** 2)
    return Offsets(offsets + inside_px, found * peak / (peak + _GRADIENT_NOISE) * robust)


def _steps(reach_px: float) -> Array:
    """Places along a profile, symmetric to 0, which is one of them."""
    count = int(np.ceil(reach_px / _STEP_PX))
    return _STEP_PX * np.arange(-count, count + 1)


def _profiles(
    picture: NDArray[np.float32], contour: Contour, steps: Array
) -> tuple[NDArray[np.float32], Array]:
    """A picture (H, W, ...) along the contour's normals, (N, S, ...), and 1 for each profile that
    lies inside the picture, else 0, (N,)."""
    at = contour.points[:, None] + steps[:, None] * contour.normals[:, None]
    height, width = picture.shape[:2]
    ends = at[:, [0, -1]]
    inside = np.all((ends >= 0) & (ends <= [width, height]), axis=(1, 2))
    x, y = np.moveaxis((at - 0.5).astype(np.float32), -1, 0)  # OpenCV's pixel centres: integers
    read = cv2.remap(picture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(read, dtype=np.float32), inside.astype(float)
