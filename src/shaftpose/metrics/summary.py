"""Confidence intervals of a test set's metrics, and the spread of its errors.

Intervals are bootstrap percentiles (Efron, 1979).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shaftpose.metrics.detection.matching import Array, detected_rate
from shaftpose.metrics.detection.precision_recall import resampled_average_precision
from shaftpose.metrics.table import ComparedImages

Interval = tuple[float, float]

_RESAMPLES, _SHARE = 1000, 0.95


@dataclass(frozen=True)
class ErrorSummary:
    """Mean of an error with its 95 % interval, median and 95th percentile."""

    mean: float
    interval: Interval
    median: float
    p95: float


@dataclass(frozen=True)
class Summary:
    """Intervals of a test set's metrics, and its errors by metric name.

    Undefined values are None. detected_rate_at_half: at the confidence threshold 0.5.
    """

    mAP: Interval | None
    detected_rate: Interval | None
    detected_rate_at_half: float | None
    errors: Mapping[str, ErrorSummary]


def summary(images: ComparedImages, further: Mapping[str, Array]) -> Summary:
    """The summary of a test set; further: other errors (M,) of the detected instruments by name."""
    count, errors = len(images.annotations), images.errors
    shown, found = (
        np.bincount(images.image_of[numbers], minlength=count)
        for numbers in (slice(None), errors.instruments)
    )
    resampled = resampled_average_precision(images.detections, images.annotations)
    return Summary(
        mAP=interval(count, resampled),
        detected_rate=_ratio_interval(found, shown),
        detected_rate_at_half=detected_rate(images.detections, images.annotations, 0.5),
        errors={
            name: _error_summary(values, images.image_of[errors.instruments], count)
            for name, values in {**errors.by_name, **further}.items()
            if np.isfinite(values).any()
        },
    )


def _error_summary(values: Array, images: NDArray[np.intp], count: int) -> ErrorSummary:
    """images: (M,) image of each value, among `count` images; NaN does not count."""
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


def interval(count: int, statistic: Callable[[NDArray[np.intp]], float | None]) -> Interval | None:
    """The 95 % interval of a statistic of `count` images.

    Images are resampled, not instruments: those of one image depend on each other. statistic: of
    the images with these numbers; None where it is undefined. Returns None if it is undefined in
    all resamples.
    """
    rng = np.random.default_rng(0)
    values = [statistic(rng.integers(count, size=count)) for _ in range(_RESAMPLES if count else 0)]
    defined = [value for value in values if value is not None]
    if not defined:
        return None
    low, high = np.quantile(defined, [(1 - _SHARE) / 2, (1 + _SHARE) / 2])
    return float(low), float(high)


def mean_interval(values: Sequence[float]) -> Interval | None:
    """The interval of the mean of one value per image."""
    array = np.array(values)
    return interval(len(array), lambda drawn: float(array[drawn].mean()))
