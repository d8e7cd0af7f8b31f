"""Overlap of boxes, and which instrument a detected box hits."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


def box_iou(a: Array, b: Array) -> Array:
    """Intersection over union (N, M) of boxes (N, 4) and (M, 4); 0 where both are empty.

    Boxes are pixel edges, so their sides are plain differences: the `+ 1` of PASCAL VOC's
    development kit belongs to its inclusive pixel indices.
    """
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, 2:], b[None, :, 2:])
    intersection = np.prod(np.clip(high - low, 0.0, None), axis=-1)
    union = _area(a)[:, None] + _area(b)[None, :] - intersection
    return intersection / np.where(union > 0, union, 1.0)


def _area(boxes: Array) -> Array:
    return np.prod(np.clip(boxes[:, 2:] - boxes[:, :2], 0.0, None), axis=-1)


def best_instruments(boxes: Array, instruments: Array, iou_threshold: float) -> Indices:
    """(K,) for each box (K, 4) the index of the instrument (G, 4) that it overlaps most; -1 where
    that overlap is below `iou_threshold`."""
    if not len(instruments):
        return np.full(len(boxes), -1, dtype=np.intp)
    overlap = box_iou(boxes, instruments)
    return np.where(overlap.max(axis=1) >= iou_threshold, overlap.argmax(axis=1), -1)


def first_hits(instruments: Indices) -> Indices:
    """Positions at which each instrument of (K,) occurs first, by instrument; -1 is no hit."""
    found, positions = np.unique(instruments, return_index=True)
    return positions[found >= 0]
