"""Detections of many frames in the order of their scores, true or false by one criterion."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from shaftpose.metrics.detection.matching import Array, Indices
from shaftpose.metrics.detection.precision_recall import PrecisionRecall
from shaftpose.metrics.frames.comparison import ComparedFrame


class Ranked:
    """The detections (N,) of all frames by one criterion, best score first.

    true, false: (N,), both False for detections that do not count; sure: (N,) which scores reach
    the confidence threshold; frames: (N,) their frames' numbers; shafts: (F,) shafts that count;
    overlaps: (N,) of true segments.
    """

    def __init__(self, frames: Sequence[ComparedFrame], criterion: str, group: str | None) -> None:
        shafts = [counted_shafts(frame, criterion, group) for frame in frames]
        scores = np.concatenate([np.empty(0), *(frame.scores for frame in frames)])
        order = np.argsort(-scores, kind="stable")
        kinds = zip(frames, shafts, strict=True)
        judged = [_judged(frame, frame.hits[criterion], counts) for frame, counts in kinds]
        true, false = np.concatenate([np.empty((2, 0), bool), *judged], axis=1)[:, order]
        sizes = [len(frame.scores) for frame in frames]
        self.scores, self.frames = scores[order], np.repeat(np.arange(len(frames)), sizes)[order]
        self.sure = np.concatenate([np.empty(0, bool), *(frame.sure for frame in frames)])[order]
        self.shafts = np.array([counts.sum() for counts in shafts])
        shown = self.shafts > 0 if group else np.ones(len(frames), dtype=bool)
        self.true, self.false = true & shown[self.frames], false & shown[self.frames]
        overlaps = np.concatenate([np.empty(0), *(frame.segment_iou for frame in frames)])
        self.overlaps = np.where(self.true, overlaps[order], 0.0)

    def curve(self, weights: Array) -> PrecisionRecall:
        """Recall and precision after each detection."""
        true, false = (np.cumsum(weights[self.frames] * kind) for kind in (self.true, self.false))
        shafts = max(float(weights @ self.shafts), 1.0)
        return PrecisionRecall(true / shafts, true / np.maximum(true + false, 1), self.scores)

    def totals(self, weights: Array) -> tuple[float, float, float]:
        """True and false sure detections, and shafts."""
        drawn = weights[self.frames] * self.sure
        return float(drawn @ self.true), float(drawn @ self.false), float(weights @ self.shafts)


def counted_shafts(frame: ComparedFrame, criterion: str, group: str | None) -> NDArray[np.bool_]:
    """(G,) whether a shaft counts."""
    counted = frame.counted[criterion]
    return counted & frame.groups[group] if group else counted


def _judged(frame: ComparedFrame, hits: Indices, counted: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(2, K): true and false detections."""
    true = np.zeros(len(hits), dtype=bool)
    true[hits >= 0] = counted[hits[hits >= 0]]
    return np.stack([true, (hits < 0) & ~frame.neutral])
