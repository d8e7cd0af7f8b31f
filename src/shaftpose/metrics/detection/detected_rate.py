"""The share of instruments that were detected (paper, IV-A)."""

from collections.abc import Sequence

from shaftpose.core.instruments import Annotations, Detections
from shaftpose.metrics.detection.boxes import best_instruments, first_hits


def detected_rate(
    detections: Sequence[Detections], annotations: Sequence[Annotations], confidence: float = 0.5
) -> float | None:
    """Share of instruments with a detection of at least this score and an IoU of `IOU_THRESHOLD`.

    A detection matches only the instrument that it overlaps most, as for pose errors: one box
    cannot detect two crossing shafts. A second detection of an instrument is not an error. None if
    the images show no instrument.
    """
    instruments = sum(len(known.boxes) for known in annotations)
    if not instruments:
        return None
    hits = [
        first_hits(best_instruments(found.above(confidence).boxes, known.boxes))
        for found, known in zip(detections, annotations, strict=True)
    ]
    return sum(map(len, hits)) / instruments
