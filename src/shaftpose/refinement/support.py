"""Scores of fitted shafts from the mask, and non-maximum suppression for poses.

A network's heat map of tips has several peaks where jaws continue a shaft. The edges of the mask
show better where the shaft ends.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.core.geometry import Camera, projected_axes
from shaftpose.refinement.contour import Array, Shaft, shaft_contour
from shaftpose.refinement.edges import mask_contrast
from shaftpose.refinement.outlines import Outline, visible_outline

_REACH_PX = 4.0
_NEAR_TIP = 1.5  # radii of the shaft in the image
# A tip lies on another shaft within `_ASIDE` radii plus `_ASIDE_PX` of its axis and `_AHEAD` radii
# in front of its tip, if the cosine of the angle between both in the image exceeds `_ALIGNED`.
_ASIDE, _ASIDE_PX, _AHEAD, _ALIGNED = 1.3, 3.0, 3.0, 0.95


def supported(
    score: float, pose: Array, mask: NDArray[np.float32], shaft: Shaft, camera: Camera
) -> float:
    """The weighted geometric mean of a detection's score (weight 1), the mask's contrast along its
    whole outline (weight 2) and next to its tip (weight 1), and the mask's mean inside the outline
    (weight 4).

    The unchanged score if no outline is in the image; 0 for a pose that is not finite or lies
    behind the camera.
    """
    if not np.isfinite(pose).all() or pose[2] <= 0:
        return 0.0
    contour, outline = shaft_contour(pose, shaft, camera), visible_outline(pose, shaft, camera)
    if not len(contour.points) or not len(outline):
        return score
    contrast, lengths = mask_contrast(mask, contour, _REACH_PX)
    if not lengths.any():
        return score
    along = float(contrast @ lengths / lengths.sum())
    away = np.linalg.norm(contour.points - camera.project(pose[:3]), axis=1)
    near = lengths * (away < _NEAR_TIP * _radius_px(pose, shaft, camera))
    at_tip = float(contrast @ near / near.sum()) if near.any() else along
    return float((score * along**2 * at_tip * _mean_inside(mask, outline) ** 4) ** (1 / 8))


def _mean_inside(mask: NDArray[np.float32], outline: Outline) -> float:
    """The mean of a mask (H, W) inside an outline, without the pixels on its edge, which a shaft
    covers in part, unless there are no others."""
    corners = np.floor(outline).astype(np.int32)
    covered = cv2.fillConvexPoly(np.zeros(mask.shape, np.uint8), corners, (1,))
    inside = cv2.polylines(covered.copy(), [corners], isClosed=True, color=(0,))
    return float(cv2.mean(mask, inside if inside.any() else covered)[0])


def distinct(poses: Array, shaft: Shaft, camera: Camera) -> list[int]:
    """Non-maximum suppression for poses (K, 5), best first: the rows to keep.

    A pose is suppressed if its tip lies on the shaft of a better pose with a similar axis.
    """
    tips, behind = np.moveaxis(projected_axes(poses, camera), 1, 0)
    axes = behind - tips
    axes = axes / np.maximum(np.linalg.norm(axes, axis=1, keepdims=True), 1e-9)
    kept: list[int] = []
    for row in range(len(poses)):
        others = (
            (tips[row] - tips[one], axes[one], _radius_px(poses[one], shaft, camera))
            for one in kept
            if axes[one] @ axes[row] > _ALIGNED
        )
        if not any(_on_axis(*other) for other in others):
            kept.append(row)
    return kept


def _on_axis(offset: Array, axis: Array, radius_px: float) -> bool:
    """Whether a point at an offset (2,) px from a tip lies on its shaft or just in front of it."""
    aside = abs(offset[0] * axis[1] - offset[1] * axis[0])
    return bool(aside < _ASIDE * radius_px + _ASIDE_PX and offset @ axis > -_AHEAD * radius_px)


def _radius_px(pose: Array, shaft: Shaft, camera: Camera) -> float:
    """The radius of a shaft in the image, at its tip."""
    return float(camera.focal_px * shaft.diameter_mm / 2 / pose[2])
