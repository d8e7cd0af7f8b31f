"""Found shafts of one frame compared with the annotated ones: which detection hits which shaft.

All pixels are the frame's. A detection hits a shaft by its box or its mask if their intersection
over union reaches 0.5, and by its axis if that differs from the annotated one by at most 5 deg and
10/299 of the frame's shorter side. Best score first, each detection takes the free shaft that it
fits best (as COCO's evaluation does).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeGuard

import numpy as np
from numpy.typing import NDArray

from shaftpose.metrics.detection.matching import IOU_THRESHOLD, Array, Indices, box_iou
from shaftpose.metrics.frames.agreement import axis_agreement, greedy_matches, mask_iou
from shaftpose.metrics.image_metrics import Mask, silhouette_iou

CRITERIA = ("box", "mask", "axis", "segment")


@dataclass(frozen=True)
class TrueShafts:
    """The annotated shafts of a frame of W x H px.

    boxes: (G, 4). masks: G of (H, W), what is visible of each. axes: (G, 2, 2), tip and tail, NaN
    where unknown. ignored: (H, W), instruments of which nobody has said where their shafts are.
    tools: (H, W), all parts of all instruments; None if they are not outlined. hidden_shares: (G,),
    NaN where unknown. groups: name -> (G,) which shafts belong to the group.
    """

    boxes: Array
    masks: Sequence[Mask]
    axes: Array
    ignored: Mask
    tools: Mask | None
    hidden_shares: Array
    groups: Mapping[str, NDArray[np.bool_]]


@dataclass(frozen=True)
class FoundShafts:
    """The detections of a frame, best score first.

    scores: (K,). boxes: (K, 4), clipped to the frame. masks: K of (H, W). axes: (K, 2, 2), two
    points from the tip towards the handle. tools: (H, W), all parts of all instruments; None from a
    model that does not say.
    """

    scores: Array
    boxes: Array
    masks: Sequence[Mask]
    axes: Array
    tools: Mask | None = None


@dataclass(frozen=True)
class ComparedFrame:
    """The detections of a frame compared with its shafts.

    scores: (K,), best first. sure: (K,), which scores reach the confidence threshold. neutral:
    (K,), whether a detection lies mostly on instruments of unknown shafts, so that it is not false.
    hits: criterion -> (K,) the shaft that each detection hits, -1 for none. counted: criterion ->
    (G,) which shafts can be hit or missed. segment_iou: (K,) overlap with the shaft that a segment
    hits. image_iou: of the unions of masks; None without a shaft. tool_iou: None without a tool, or
    if nobody says where tools are. empty: whether the frame shows no instrument. hidden_shares,
    groups: as in `TrueShafts`.
    """

    scores: Array
    sure: NDArray[np.bool_]
    neutral: NDArray[np.bool_]
    hits: Mapping[str, Indices]
    counted: Mapping[str, NDArray[np.bool_]]
    segment_iou: Array
    image_iou: float | None
    tool_iou: float | None
    empty: bool
    hidden_shares: Array
    groups: Mapping[str, NDArray[np.bool_]]


def compare_frame(true: TrueShafts, found: FoundShafts, threshold: float) -> ComparedFrame:
    """Compare all detections by box, mask and axis, and those with a score of at least `threshold`
    by segments and unions of masks.

    Segments are masks of which each pixel belongs to the best score alone, without ignored pixels
    (Kirillov et al., Panoptic Segmentation, 2019); they hit by more than half of the union.
    """
    sure = found.scores >= threshold
    shown = [mask for mask, kept in zip(found.masks, sure, strict=True) if kept]
    overlaps = mask_iou(found.masks, true.masks)
    parts = np.zeros_like(overlaps)
    parts[sure] = mask_iou(_segments(shown, true.ignored), true.masks)
    known = np.isfinite(true.axes).all(axis=(1, 2))
    masks = _reaching(overlaps, IOU_THRESHOLD)
    agreement = {
        "box": _reaching(box_iou(found.boxes, true.boxes), IOU_THRESHOLD),
        "mask": masks,
        "axis": np.where(known, axis_agreement(found.axes, true.axes, true.ignored.shape), masks),
        "segment": np.where(parts > IOU_THRESHOLD, parts, 0.0),
    }
    hits = {criterion: greedy_matches(values) for criterion, values in agreement.items()}
    every = np.ones(len(true.masks), dtype=bool)
    return ComparedFrame(
        scores=found.scores,
        sure=sure,
        neutral=_mostly_on(true.ignored, found.masks),
        hits=hits,
        counted={criterion: known if criterion == "axis" else every for criterion in CRITERIA},
        segment_iou=_of_hits(agreement["segment"], hits["segment"]),
        image_iou=silhouette_iou(true.masks, shown, true.ignored) if len(every) else None,
        tool_iou=_tool_iou(true.tools, found.tools),
        empty=not (len(every) or true.ignored.any() or _any(true.tools)),
        hidden_shares=true.hidden_shares,
        groups=true.groups,
    )


def _segments(masks: Sequence[Mask], ignored: Mask) -> list[Mask]:
    taken, segments = ignored.copy(), []
    for mask in masks:
        segments.append(mask & ~taken)
        taken |= mask
    return segments


def _reaching(overlaps: Array, least: float) -> Array:
    return np.where(overlaps >= least, overlaps, 0.0)


def _mostly_on(ignored: Mask, masks: Sequence[Mask]) -> NDArray[np.bool_]:
    shares = [2 * np.count_nonzero(mask & ignored) > np.count_nonzero(mask) for mask in masks]
    return np.array(shares, dtype=bool)


def _of_hits(agreement: Array, hits: Indices) -> Array:
    """(K,) the agreement of each detection with the shaft that it hits, 0 for none."""
    hit = np.flatnonzero(hits >= 0)
    values = np.zeros(len(hits))
    values[hit] = agreement[hit, hits[hit]]
    return values


def _tool_iou(true: Mask | None, found: Mask | None) -> float | None:
    return None if found is None or not _any(true) else silhouette_iou([true], [found])


def _any(mask: Mask | None) -> TypeGuard[Mask]:
    return mask is not None and bool(mask.any())
