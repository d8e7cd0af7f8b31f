"""Where the edges of a picture lie along the normals of a contour."""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.deployment.refinement.contour import Array, Contour

_STEP_PX = 0.5  # between the samples of a profile
_GRADIENT_NOISE = 15.0  # grey levels per px; weaker edges count less


class Offsets(NamedTuple):
    """px: (N,) distance of the edge from the contour, positive outwards; weights: (N,) in [0, 1],
    how clear and near each edge is."""

    px: Array
    weights: Array


def mask_offsets(mask: NDArray[np.float32], contour: Contour, reach_px: float) -> Offsets:
    """Edges of a soft mask (H, W) in [0, 1], within `reach_px` of the contour.

    The integral over the profile of a step from 1 to 0 is where the step lies, without a threshold.
    """
    steps = np.arange(-reach_px, reach_px + 0.01, _STEP_PX)
    profiles, inside = _profiles(mask, contour, steps)
    offsets = profiles.mean(axis=1) * 2 * reach_px - reach_px
    contrast = np.clip(profiles[:, 0] - profiles[:, -1], 0.0, 1.0) * inside.astype(float)
    robust = 1 / (1 + (offsets / (0.3 * reach_px)) ** 2)
    return Offsets(offsets, contrast**2 * robust)


def image_gradients(rgb: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Gradients of an image (H, W, 3) by x and y, grey levels per px; (2, H, W, 3)."""
    smooth = cv2.GaussianBlur(rgb.astype(np.float32), (0, 0), 0.7)
    return np.stack([cv2.Scharr(smooth, cv2.CV_32F, *by) / 32 for by in ((1, 0), (0, 1))])


def image_offsets(gradients: NDArray[np.float32], contour: Contour, reach_px: float) -> Offsets:
    """Edges of an image with gradients (2, H, W, 3): along each normal the strongest one, weighted
    by its nearness. Reliable only from a start within a px: metal has strong edges of its own."""
    steps = np.arange(-3 * reach_px, 3 * reach_px + 0.01, _STEP_PX)
    by_x, by_y = (_profiles(g, contour, steps) for g in gradients)
    normals = contour.normals[:, None, None]
    strength = np.linalg.norm(by_x[0] * normals[..., 0] + by_y[0] * normals[..., 1], axis=-1)
    nearness = np.exp(-(steps**2) / (2 * reach_px**2))
    best = np.clip((strength * nearness).argmax(axis=1), 1, len(steps) - 2)
    rows = np.arange(len(best))
    before, peak, after = (strength[rows, best + k] for k in (-1, 0, 1))
    bend = before - 2 * peak + after
    curved = (peak >= before) & (peak >= after) & (bend < -1e-6)
    offsets = steps[best] + _STEP_PX * np.where(
        curved, 0.5 * (before - after) / np.where(curved, bend, 1.0), 0.0
    )
    contrast = peak / (peak + _GRADIENT_NOISE) * by_x[1]
    robust = 1 / (1 + (offsets / (0.7 * reach_px + 0.15)) ** 2)
    return Offsets(offsets, contrast * robust)


def _profiles(
    picture: NDArray[np.float32], contour: Contour, steps: Array
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """A picture (H, W, ...) along the contour's normals, (N, S, ...), and whether each profile lies
    inside the picture, (N,)."""
    at = contour.points[:, None] + steps[:, None] * contour.normals[:, None]
    height, width = picture.shape[:2]
    ends = at[:, [0, -1]]
    inside = np.all((ends >= 0) & (ends <= [width, height]), axis=(1, 2))
    x, y = np.moveaxis((at - 0.5).astype(np.float32), -1, 0)  # OpenCV's pixel centres: integers
    read = cv2.remap(picture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(read, dtype=np.float32), inside
