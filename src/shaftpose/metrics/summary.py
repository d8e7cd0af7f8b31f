"""How sure the metrics of a test set are, and how their errors are spread."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.instruments import Annotations, Detections
from shaftpose.metrics.bootstrap import Interval, interval
from shaftpose.metrics.detection.average_precision import resampled_average_precision
from shaftpose.metrics.detection.boxes import Array
from shaftpose.metrics.detection.detected_rate import detected_rate
from shaftpose.metrics.pose_errors import PoseErrors


@dataclass(frozen=True)
class ErrorSummary:
    """Of one error: the 95 % interval of its mean, its median and its 95th percentile."""

    mean: float
    interval: Interval
    median: float
    p95: float


@dataclass(frozen=True)
class Summary:
    """Of a test set: intervals, and errors by metric name; None where they are undefined."""

    mAP: Interval | None
    detected_rate: Interval | None
    detected_rate_at_half: float | None  # at the confidence threshold 0.5
    errors: Mapping[str, ErrorSummary]


def summary(
    detections: Sequence[Detections],
    annotations: Sequence[Annotations],
    errors: PoseErrors,
    further: Mapping[str, Array],
) -> Summary:
    """The summary of a test set.

    errors: of the detected instruments; further: other errors (M,) of the same instruments.
    """
    image_of = np.repeat(np.arange(len(annotations)), [len(known.boxes) for known in annotations])
    shown, found = (
        np.bincount(image_of[numbers], minlength=len(annotations))
        for numbers in (slice(None), errors.instruments)
    )
    return Summary(
        mAP=interval(len(annotations), resampled_average_precision(detections, annotations)),
        detected_rate=_ratio_interval(found, shown),
        detected_rate_at_half=detected_rate(detections, annotations, 0.5),
        errors={
            name: _error_summary(values, image_of[errors.instruments], len(annotations))
            for name, values in {**errors.by_name, **further}.items()
            if np.isfinite(values).any()
        },
    )


def _error_summary(values: Array, images: NDArray[np.intp], count: int) -> ErrorSummary:
    """images: (M,) image of each value, of `count` images; values that are NaN do not count."""
    defined = np.isfinite(values)
    values, images = values[defined], images[defined]
    sums, counts = np.bincount(images, values, count), np.bincount(images, minlength=count)
    found = _ratio_interval(sums, counts)
    assert found is not None
    return ErrorSummary(
        mean=float(values.mean()),
        interval=found,
        median=float(np.median(values)),
        p95=float(np.quantile(values, 0.95)),
    )


def _ratio_interval(parts: NDArray[np.generic], wholes: NDArray[np.intp]) -> Interval | None:
    """The interval of sum(parts) / sum(wholes), both (images,)."""

    def ratio(drawn: NDArray[np.intp]) -> float | None:
        whole = wholes[drawn].sum()
        return float(parts[drawn].sum() / whole) if whole else None

    return interval(len(wholes), ratio)
