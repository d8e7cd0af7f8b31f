"""Metrics of a set of whole frames, with bootstrap intervals over operations.

A metric is a function of the frames' weights, the number of times that each frame counts. In a
group of shafts, frames without one of them do not count, and detections that hit other shafts are
neither true nor false (as COCO's evaluation does with sizes of objects).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from shaftpose.metrics.detection.matching import Array, Indices
from shaftpose.metrics.detection.precision_recall import average_precision
from shaftpose.metrics.frames.comparison import ComparedFrame
from shaftpose.metrics.frames.ranking import Ranked, counted_shafts
from shaftpose.metrics.summary import interval

PRECISION = 0.9  # at which the recall of axes is stated

# A metric for weights (F,) of the frames; None where it is undefined.
Statistic = Callable[[Array], float | None]


@dataclass(frozen=True)
class Estimate:
    """A metric; low, high: its 95 % interval, None for frames of one operation."""

    value: float | None
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True)
class Counts:
    """Numbers of a group. shafts: annotated ones; found, missed, false: segments above the
    confidence threshold; operations: that show such shafts."""

    frames: int
    operations: int
    shafts: int
    found: int
    missed: int
    false: int


@dataclass(frozen=True)
class FrameMetrics:
    """Metrics by name, and counts, of a group of shafts. hidden_share: the mean of those that are
    known."""

    counts: Counts
    hidden_share: float | None
    metrics: Mapping[str, Estimate]


def frame_metrics(
    frames: Sequence[ComparedFrame], operations: Sequence[str], group: str | None = None
) -> FrameMetrics:
    """All metrics of the shafts of a group, None for all.

    operations: (F,), each frame's; frames of one depend on each other, so operations are resampled.
    """
    names, operation_of = np.unique(np.array(operations, dtype=str), return_inverse=True)
    statistics = _statistics(frames, group)
    every = np.ones(len(frames))

    def estimate(statistic: Statistic) -> Estimate:
        def resampled(drawn: Indices) -> float | None:
            times = np.bincount(drawn, minlength=len(names))
            return statistic(times[operation_of].astype(np.float64))

        ends = interval(len(names), resampled) if len(names) > 1 else None
        return Estimate(statistic(every), *(ends or (None, None)))

    segments = Ranked(frames, "segment", group)
    true, false, shafts = (int(total) for total in segments.totals(every))
    shown = segments.shafts > 0 if group else every > 0
    shown_operations = len(np.unique(operation_of[shown]))
    hidden = [frame.hidden_shares[counted_shafts(frame, "segment", group)] for frame in frames]
    return FrameMetrics(
        Counts(int(shown.sum()), shown_operations, shafts, true, shafts - true, false),
        _mean_of_known(np.concatenate([np.empty(0), *hidden])),
        {name: estimate(each) for name, each in statistics.items()},
    )


def _mean_of_known(values: Array) -> float | None:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else None


def _statistics(frames: Sequence[ComparedFrame], group: str | None) -> dict[str, Statistic]:
    box, mask, axis, segment = (
        Ranked(frames, criterion, group) for criterion in ("box", "mask", "axis", "segment")
    )
    statistics = {
        "box_ap50": _average_precision(box),
        "mask_ap50": _average_precision(mask),
        "box_recall": _recall(box),
        "box_precision": _precision(box),
        "axis_recall": _recall(axis),
        "axis_precision": _precision(axis),
        "axis_recall_at_precision": _recall_at_precision(axis),
        "pq": _quality(segment, error_weight=0.5),
        "shaft_iou": _quality(segment, error_weight=1.0),
        "image_iou": _mean(
            [f.image_iou if counted_shafts(f, "segment", group).any() else None for f in frames]
        ),
    }
    if group is None:
        statistics["tool_iou"] = _mean([frame.tool_iou for frame in frames])
        statistics["empty_detected"] = _mean(
            [float(f.sure.any()) if f.empty else None for f in frames]
        )
    return statistics


def _average_precision(ranked: Ranked) -> Statistic:
    def statistic(weights: Array) -> float | None:
        return average_precision(ranked.curve(weights)) if weights @ ranked.shafts else None

    return statistic


def _recall(ranked: Ranked) -> Statistic:
    def statistic(weights: Array) -> float | None:
        true, _, shafts = ranked.totals(weights)
        return true / shafts if shafts else None

    return statistic


def _precision(ranked: Ranked) -> Statistic:
    def statistic(weights: Array) -> float | None:
        true, false, _ = ranked.totals(weights)
        return true / (true + false) if true + false else None

    return statistic


def _recall_at_precision(ranked: Ranked) -> Statistic:
    """The best recall at any threshold with a precision of at least `PRECISION`."""

    def statistic(weights: Array) -> float | None:
        curve = ranked.curve(weights)
        precise = curve.recall[curve.precision >= PRECISION]
        return float(precise.max(initial=0.0)) if weights @ ranked.shafts else None

    return statistic


def _quality(ranked: Ranked, error_weight: float) -> Statistic:
    """Sum of the true segments' overlaps over true + error_weight x (false + missed): the panoptic
    quality for 0.5."""

    def statistic(weights: Array) -> float | None:
        true, false, shafts = ranked.totals(weights)
        drawn = weights[ranked.frames] * ranked.sure
        segments = true + error_weight * (false + shafts - true)
        return float(drawn @ ranked.overlaps) / segments if segments else None

    return statistic


def _mean(values: Sequence[float | None]) -> Statistic:
    """The mean of one value of each frame that has one."""
    known = np.array([value is not None for value in values], dtype=np.float64)
    numbers = np.array([value or 0.0 for value in values])

    def statistic(weights: Array) -> float | None:
        total = float(weights @ known)
        return float(weights @ numbers) / total if total else None

    return statistic
