"""Precision and recall, average precision (PASCAL VOC 2010) and the best confidence threshold."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.instruments import Annotations, Detections
from shaftpose.metrics.detection.matching import Array, Indices, best_instruments, first_hits


@dataclass(frozen=True)
class PrecisionRecall:
    """Recall, precision and score (K,) after each detection of a set, best score first."""

    recall: Array
    precision: Array
    scores: Array


def precision_recall(
    detections: Sequence[Detections], annotations: Sequence[Annotations]
) -> PrecisionRecall:
    """The precision-recall curve over a set of images.

    By descending score, a detection is a true positive if its IoU with the instrument that it
    overlaps most reaches `IOU_THRESHOLD` and that instrument was not detected before. A second
    detection of an instrument is a false positive, never matched to the next best one (as in VOC's
    development kit). Recall is 0 if the set has no instrument.
    """
    scores, order, right = _ranked(detections, annotations)
    instruments = sum(len(known.boxes) for known in annotations)
    true_positives = np.cumsum(right)
    return PrecisionRecall(
        recall=true_positives / max(instruments, 1),
        precision=true_positives / np.arange(1, len(right) + 1),
        scores=scores,
    )


def average_precision(curve: PrecisionRecall) -> float:
    """Area under the precision envelope, at every recall (VOC 2010, not the older 11 points)."""
    recall = np.concatenate([[0.0], curve.recall])
    envelope = np.maximum.accumulate(curve.precision[::-1])[::-1]
    return float(np.sum(np.diff(recall) * envelope))


def resampled_average_precision(
    detections: Sequence[Detections], annotations: Sequence[Annotations]
) -> Callable[[Indices], float | None]:
    """Average precision of resampled images, as a function of the numbers of the drawn ones.

    It equals that of the drawn images as a set, and is None for a draw without instruments.
    """
    scores, order, right = _ranked(detections, annotations)
    image_of = np.repeat(np.arange(len(detections)), [len(found.scores) for found in detections])
    image_of, shown = image_of[order], np.array([len(known.boxes) for known in annotations])

    def resampled(drawn: Indices) -> float | None:
        times = np.bincount(drawn, minlength=len(shown))
        instruments, weights = np.sum(times * shown), times[image_of]
        if not instruments:
            return None
        true_positives, all_of_them = np.cumsum(weights * right), np.cumsum(weights)
        precision = true_positives / np.maximum(all_of_them, 1)
        return average_precision(PrecisionRecall(true_positives / instruments, precision, scores))

    return resampled


def _ranked(
    detections: Sequence[Detections], annotations: Sequence[Annotations]
) -> tuple[Array, Indices, NDArray[np.bool_]]:
    """Of the detections (K,) of all images, best first: the scores, the order, and whether each is
    a true positive."""
    scores = np.concatenate([np.empty(0), *(found.scores for found in detections)])
    order = np.argsort(-scores, kind="stable")
    right = np.zeros(len(scores), dtype=bool)
    right[first_hits(_hit_instruments(detections, annotations)[order])] = True
    return scores[order], order, right


def _hit_instruments(
    detections: Sequence[Detections], annotations: Sequence[Annotations]
) -> Indices:
    """(K,) the instrument that each detection hits, numbered across all images; -1 for none."""
    hits, offset = [np.empty(0, dtype=np.intp)], 0
    for found, known in zip(detections, annotations, strict=True):
        best = best_instruments(found.boxes, known.boxes)
        hits.append(np.where(best >= 0, best + offset, -1))
        offset += len(known.boxes)
    return np.concatenate(hits)


def f1_scores(curve: PrecisionRecall) -> Array:
    """F1 (K,), the harmonic mean of precision and recall, at each score; 0 if both are 0."""
    total = curve.precision + curve.recall
    return np.asarray(2 * curve.precision * curve.recall / np.where(total > 0, total, 1.0))


def best_confidence(curve: PrecisionRecall) -> float:
    """The confidence threshold with the best F1; 0.5 if no detection is a true positive.

    Scores are not probabilities: with three hard negatives for each positive, they stay low after a
    short training. The curve must come from validation images, not from test images.
    """
    f1 = f1_scores(curve)
    return float(curve.scores[f1.argmax()]) if f1.any() else 0.5
