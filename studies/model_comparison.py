"""Comparison of a model stored in fewer bytes with the exported one."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from shaftpose.core.instruments import Annotations
from shaftpose.core.shards import ShardedDataset
from shaftpose.inference.predictor import Predictor
from shaftpose.inference.shard_prediction import predict_shards
from shaftpose.metrics.metrics import evaluate
from shaftpose.metrics.pose_errors import PoseErrors, pose_errors
from shaftpose.metrics.table import MetricValues
from shaftpose.report.cells import show

# Limits: change of the mAP, growth of mean errors, and least share of common detections (rounding
# moves a few scores across the threshold). Rounding can also make an ambiguous fit take another
# of its starts: its pose changes, mean errors do not.
MAP_CHANGE, GROWTH, LEAST_SHARED = 0.005, 0.03, 0.95


@dataclass(frozen=True)
class Comparison:
    """The exported and the stored model on the same images.

    shared: share of the exported model's detections that the stored one also has; moved: mean
    absolute differences of their poses by metric name, mm and deg; None if nothing is shared.
    growth: the relative change of each mean error over the shafts that both find.
    """

    exported: MetricValues
    stored: MetricValues
    shared: float
    moved: Mapping[str, float | None]
    growth: Mapping[str, float]

    @property
    def map_change(self) -> float:
        """The stored model's mAP minus the exported one's."""
        return (self.stored["mAP"] or 0.0) - (self.exported["mAP"] or 0.0)

    @property
    def holds(self) -> bool:
        """Whether the stored model is as good as the exported one."""
        worse = any(self.growth[name] > GROWTH for name in ("tip_mm", "axis_deg"))
        return self.shared >= LEAST_SHARED and abs(self.map_change) <= MAP_CHANGE and not worse

    def __str__(self) -> str:
        moved = ", ".join(f"{name} {show(value, 4)}" for name, value in self.moved.items())
        return (
            f"{100 * self.shared:.2f} % of the exported model's detections are shared, the mAP "
            f"changes by {self.map_change:+.5f}, their poses on average by {moved}"
        )


def compare(
    exported: Predictor, stored: Predictor, shards: ShardedDataset, keys: Sequence[str]
) -> Comparison:
    """Compare both models on these images at the exported model's confidence threshold."""
    first, known = predict_shards(exported, shards, keys)
    second, _ = predict_shards(stored, shards, keys)
    confidence = exported.confidence
    counted = [found.above(confidence) for found in first]
    moved = pose_errors(second, [Annotations(f.boxes, f.poses) for f in counted], confidence)
    both = (pose_errors(found, known, confidence) for found in (first, second))
    return Comparison(
        exported=evaluate(first, known, confidence),
        stored=evaluate(second, known, confidence),
        shared=len(moved.tip_mm) / max(1, sum(len(found.boxes) for found in counted)),
        moved=moved.means(),
        growth=growth_between(*both),
    )


def growth_between(before: PoseErrors, after: PoseErrors) -> dict[str, float]:
    """The relative change of mean errors by metric name; NaN where they are undefined or 0."""
    _, first, second = np.intersect1d(before.instruments, after.instruments, return_indices=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        return {
            name: float(after.by_name[name][second].sum() / errors[first].sum() - 1)
            for name, errors in before.by_name.items()
        }
