"""Matching of detected boxes to instruments."""

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.geometry import box_iou

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

IOU_THRESHOLD = 0.5  # least overlap of a detection with its instrument


def best_instruments(boxes: Array, instruments: Array) -> Indices:
    """(K,) index of the instrument (G, 4) that each box (K, 4) overlaps most; -1 where the IoU is
    below `IOU_THRESHOLD`."""
    if not len(instruments):
        return np.full(len(boxes), -1, dtype=np.intp)
    overlap = box_iou(boxes, instruments)
    return np.where(overlap.max(axis=1) >= IOU_THRESHOLD, overlap.argmax(axis=1), -1)


def first_hits(instruments: Indices) -> Indices:
    """Position of the first hit of each instrument in (K,), by instrument; -1 is no hit."""
    found, positions = np.unique(instruments, return_index=True)
    return positions[found >= 0]
