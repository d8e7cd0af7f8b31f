"""The share of instruments that were found (paper, IV-A)."""

from collections.abc import Sequence

from shaftpose.evaluation.boxes import best_instruments, first_hits
from shaftpose.instruments import Annotations, Detections


def detected_rate(
    detections: Sequence[Detections],
    annotations: Sequence[Annotations],
    confidence: float = 0.5,
    iou_threshold: float = 0.5,
) -> float | None:
    """Share of instruments with a detection of at least this score and overlap.

    A detection finds the instrument that it overlaps most and no other, as in the pose errors: of
    two shafts that cross, one box finds one. An instrument that is found twice counts as found, not
    as an error. None if the images hold no instrument at all.
    """
    instruments = sum(len(known.boxes) for known in annotations)
    if not instruments:
        return None
    found = sum(
        _found(guesses.above(confidence), known, iou_threshold)
        for guesses, known in zip(detections, annotations, strict=True)
    )
    return found / instruments


def _found(detections: Detections, annotations: Annotations, iou_threshold: float) -> int:
    return len(first_hits(best_instruments(detections.boxes, annotations.boxes, iou_threshold)))
