"""Matching of detections to instruments by the overlap of their boxes."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.instruments import Annotations, Detections

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

IOU_THRESHOLD = 0.5  # least overlap of a detection with its instrument


def box_iou(a: Array, b: Array) -> Array:
    """Intersection over union (N, M) of boxes (N, 4) and (M, 4); 0 where both are empty.

    Box coordinates are pixel edges, so side lengths are plain differences; PASCAL VOC's
    development kit adds 1 because its pixel indices are inclusive.
    """
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, 2:], b[None, :, 2:])
    intersection = np.prod(np.clip(high - low, 0.0, None), axis=-1)
    union = _box_area(a)[:, None] + _box_area(b)[None, :] - intersection
    overlap: Array = intersection / np.where(union > 0, union, 1.0)
    return overlap


def _box_area(boxes: Array) -> Array:
    area: Array = np.prod(np.clip(boxes[:, 2:] - boxes[:, :2], 0.0, None), axis=-1)
    return area


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


def matched_poses(
    detections: Detections, instruments: Array, confidence: float
) -> tuple[Array, Indices]:
    """Poses (M, 5) of matched detections, and the numbers (M,) of their instruments.

    instruments: boxes (G, 4). A detection with a score of at least `confidence` matches the
    instrument that it overlaps most, if their IoU is at least `IOU_THRESHOLD`. Of several
    detections of an instrument, the best score counts.
    """
    found = detections.above(confidence)
    order = np.argsort(-found.scores, kind="stable")
    hit = best_instruments(found.boxes[order], instruments)
    first = first_hits(hit)
    return found.poses[order][first], hit[first]


def detected_rate(
    detections: Sequence[Detections], annotations: Sequence[Annotations], confidence: float = 0.5
) -> float | None:
    """Share of instruments that a detection with a score of at least `confidence` matches (paper,
    IV-A).

    One box cannot detect two crossing shafts. A second detection of an instrument is not an error.
    None if the images show no instrument.
    """
    instruments = sum(len(known.boxes) for known in annotations)
    if not instruments:
        return None
    hits = [
        first_hits(best_instruments(found.above(confidence).boxes, known.boxes))
        for found, known in zip(detections, annotations, strict=True)
    ]
    return sum(map(len, hits)) / instruments


def nearest_pairs(distances: Array, most: float) -> dict[int, int]:
    """Greedy one-to-one pairs of distances (N, M) up to `most`, nearest first: row -> column."""
    near = np.argwhere(distances <= most)
    order = np.argsort(distances[tuple(near.T)], kind="stable")
    pairs: dict[int, int] = {}
    taken: set[int] = set()
    for row, column in near[order].tolist():
        if row not in pairs and column not in taken:
            pairs[row] = column
            taken.add(column)
    return pairs
