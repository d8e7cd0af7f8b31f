"""The symmetries of images, with their annotations."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.geometry import unsigned_deg
from shaftpose.core.images import Image
from shaftpose.core.instruments import Annotations


def random_symmetry(
    rgb: Image, known: Annotations, rng: np.random.Generator
) -> tuple[Image, Annotations]:
    """Apply one of the eight symmetries of a square image (S, S, 3), chosen uniformly.

    Poses stay exact if the principal point is the image's centre. The scope's lights, left and
    right of the lens, are mirrored and turned as well.
    """
    for symmetry in GENERATORS:
        if rng.random() < 0.5:
            rgb, known = symmetry(rgb, known)
    return np.ascontiguousarray(rgb), known


def mirrored_x(rgb: Image, known: Annotations) -> tuple[Image, Annotations]:
    """Swap left and right: x becomes -x, yaw 180 deg - yaw."""
    side = rgb.shape[1]
    x0, y0, x1, y1 = known.boxes.T
    boxes = np.stack([side - x1, y0, side - x0, y1], axis=1)
    instances = None if known.instances is None else known.instances[:, ::-1]
    tips = None if known.tips_px is None else np.array([side, 0]) + known.tips_px * [-1, 1]
    poses = _changed(known.poses, (-1, 1), 180.0)
    return rgb[:, ::-1], replace(known, boxes=boxes, poses=poses, instances=instances, tips_px=tips)


def mirrored_y(rgb: Image, known: Annotations) -> tuple[Image, Annotations]:
    """Swap top and bottom: y becomes -y, yaw -yaw."""
    side = rgb.shape[0]
    x0, y0, x1, y1 = known.boxes.T
    boxes = np.stack([x0, side - y1, x1, side - y0], axis=1)
    instances = None if known.instances is None else known.instances[::-1]
    tips = None if known.tips_px is None else np.array([0, side]) + known.tips_px * [1, -1]
    poses = _changed(known.poses, (1, -1), 0.0)
    return rgb[::-1], replace(known, boxes=boxes, poses=poses, instances=instances, tips_px=tips)


def transposed(rgb: Image, known: Annotations) -> tuple[Image, Annotations]:
    """Swap rows and columns: x becomes y, y becomes x, yaw 90 deg - yaw."""
    poses = _changed(known.poses, (1, 1), 90.0)
    if poses is not None:
        poses[:, :2] = poses[:, 1::-1]
    instances = None if known.instances is None else known.instances.T
    tips = None if known.tips_px is None else known.tips_px[:, ::-1]
    boxes = known.boxes[:, [1, 0, 3, 2]]
    return rgb.transpose(1, 0, 2), replace(
        known, boxes=boxes, poses=poses, instances=instances, tips_px=tips
    )


def _changed(
    poses: NDArray[np.float64] | None, signs: tuple[int, int], yaw_deg: float
) -> NDArray[np.float64] | None:
    """Poses (G, 5) with x and y times `signs` and yaw `yaw_deg` - yaw, in [0, 360)."""
    if poses is None:
        return None
    poses = poses.copy()
    poses[:, :2] *= signs
    poses[:, 4] = unsigned_deg(yaw_deg - poses[:, 4])
    return poses


# Each undoes itself; all eight symmetries are some of them, one after another.
GENERATORS = mirrored_x, mirrored_y, transposed
