"""Random geometric changes of training images, with their annotations."""

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.core.geometry import unsigned_deg
from shaftpose.core.images import Image
from shaftpose.core.instruments import Annotations
from shaftpose.core.masks import mask_box

_ZOOMS = 0.8, 1.6
_SHIFT = 0.25  # the most by which the centre moves, relative to the side
_LEAST_PX = 100  # of an instrument, which must stay in view
_TRIES = 10


def random_symmetry(
    rgb: Image, known: Annotations, rng: np.random.Generator
) -> tuple[Image, Annotations]:
    """Apply one of the eight symmetries of a square image (S, S, 3), chosen uniformly.

    Poses stay exact if the principal point is the image's centre. The scope's lights, left and
    right of the lens, are mirrored and turned as well.
    """
    for symmetry in (mirrored_x, mirrored_y, transposed):
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
    return rgb[:, ::-1], Annotations(boxes, _changed(known.poses, (-1, 1), 180.0), instances, tips)


def mirrored_y(rgb: Image, known: Annotations) -> tuple[Image, Annotations]:
    """Swap top and bottom: y becomes -y, yaw -yaw."""
    side = rgb.shape[0]
    x0, y0, x1, y1 = known.boxes.T
    boxes = np.stack([x0, side - y1, x1, side - y0], axis=1)
    instances = None if known.instances is None else known.instances[::-1]
    tips = None if known.tips_px is None else np.array([0, side]) + known.tips_px * [1, -1]
    return rgb[::-1], Annotations(boxes, _changed(known.poses, (1, -1), 0.0), instances, tips)


def transposed(rgb: Image, known: Annotations) -> tuple[Image, Annotations]:
    """Swap rows and columns: x becomes y, y becomes x, yaw 90 deg - yaw."""
    poses = _changed(known.poses, (1, 1), 90.0)
    if poses is not None:
        poses[:, :2] = poses[:, 1::-1]
    instances = None if known.instances is None else known.instances.T
    tips = None if known.tips_px is None else known.tips_px[:, ::-1]
    boxes = known.boxes[:, [1, 0, 3, 2]]
    return rgb.transpose(1, 0, 2), Annotations(boxes, poses, instances, tips)


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


def random_similarity(
    rgb: Image, known: Annotations, rng: np.random.Generator
) -> tuple[Image, Annotations]:
    """Scale, rotate and shift a square image (S, S, 3) without poses; uncovered pixels are black.

    A part of every instrument stays in view. No tip enters or leaves the image: one that entered
    would lie on black. The image is returned unchanged if ten draws fail, if it lacks an instrument
    map, or if its poses are known, because they would be wrong at another scale.

    Images without poses are few: unchanged, a network would learn them by heart.
    """
    if known.poses is not None or known.instances is None:
        return rgb, known
    for _ in range(_TRIES):
        matrix = _drawn(rgb.shape[0], rng)
        changed = _annotations(known, matrix)
        if changed is not None:
            side = rgb.shape[:2]
            return np.asarray(cv2.warpAffine(rgb, _of_indices(matrix), side), np.uint8), changed
    return rgb, known


def _drawn(side: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """A random similarity (2, 3) of points in px."""
    zoom = np.exp(rng.uniform(*np.log(_ZOOMS)))
    turn = rng.uniform(0, 2 * np.pi)
    linear = zoom * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    middle = side * (0.5 + rng.uniform(-_SHIFT, _SHIFT, 2))
    return np.column_stack([linear, side / 2 - linear @ middle])


def _of_indices(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same map for OpenCV, which has the centre of pixel 0 at 0, not at 0.5 px."""
    linear, shift = matrix[:, :2], matrix[:, 2]
    return np.column_stack([linear, shift + linear @ [0.5, 0.5] - 0.5])


def _annotations(known: Annotations, matrix: NDArray[np.float64]) -> Annotations | None:
    """Changed annotations; None if a tip enters or leaves the image, or an instrument leaves."""
    assert known.instances is not None
    side = known.instances.shape[0]
    instances = np.asarray(
        cv2.warpAffine(known.instances, _of_indices(matrix), (side, side), flags=cv2.INTER_NEAREST),
        np.uint8,
    )
    masks = [instances == number for number in range(1, len(known.boxes) + 1)]
    if any(np.count_nonzero(mask) < _LEAST_PX for mask in masks):
        return None
    tips = known.tips_px
    if tips is not None:
        seen = _inside(tips, side)
        tips = tips @ matrix[:, :2].T + matrix[:, 2]
        if np.any(_inside(tips, side) != seen):
            return None
    boxes = np.array([mask_box(mask) for mask in masks], np.float64).reshape(-1, 4)
    return Annotations(boxes, None, instances, tips)


def _inside(points: NDArray[np.float64], side: int) -> NDArray[np.bool_]:
    """Which points (G, 2) lie in the image. Unknown points, which are NaN, do not."""
    inside: NDArray[np.bool_] = np.all((points >= 0) & (points <= side), axis=1)
    return inside
