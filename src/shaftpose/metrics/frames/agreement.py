"""How far found shafts of a frame agree with true ones: overlaps of masks, and axes."""

from collections.abc import Sequence

import numpy as np

from shaftpose.metrics.detection.matching import Array, Indices
from shaftpose.metrics.image_metrics import Mask

AXIS_DEG, AXIS_SHARE = 5.0, 10 / 299  # most; the share is of the frame's shorter side


def mask_iou(found: Sequence[Mask], true: Sequence[Mask]) -> Array:
    """Intersection over union (K, G) of masks (H, W); 0 where both are empty."""
    overlaps = np.zeros((len(found), len(true)))
    for row, one in enumerate(found):
        for column, other in enumerate(true):
            union = np.count_nonzero(one | other)
            overlaps[row, column] = np.count_nonzero(one & other) / max(union, 1)
    return overlaps


def axis_agreement(found: Array, true: Array, shape: tuple[int, ...]) -> Array:
    """How near found axes (K, 2, 2) come to true ones (G, 2, 2): (K, G), 1 for the same line, 0.5
    at the limit, 0 beyond it or for another direction.

    The distance is that of the true tip and tail from the found axis as an endless line, the larger
    one. Angles are those in the picture as it is. shape: height and width of the frame.
    """
    limit_px = AXIS_SHARE * min(shape)
    ways = [axes[:, 1] - axes[:, 0] for axes in (found, true)]
    found_way, true_way = (
        way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9) for way in ways
    )
    away = true[None] - found[:, None, :1]
    across = np.stack([-found_way[:, 1], found_way[:, 0]], axis=1)
    distances = np.abs(np.einsum("kgpc,kc->kgp", away, across)).max(axis=2)
    right = (distances <= limit_px) & (found_way @ true_way.T >= np.cos(np.radians(AXIS_DEG)))
    return np.where(right, limit_px / (limit_px + distances), 0.0)


def greedy_matches(agreement: Array) -> Indices:
    """(K,) the shaft that each detection hits, -1 for none; agreement: (K, G), 0 where it cannot.

    In turn, each detection takes the shaft with which it agrees most, of those not yet taken.
    """
    free = agreement.copy()
    hits = np.full(len(free), -1, dtype=np.intp)
    for row in range(len(free)):
        if free.shape[1] and free[row].max() > 0:
            hits[row] = free[row].argmax()
            free[:, hits[row]] = 0.0
    return hits
