"""Bootstrap confidence intervals (Efron, 1979; the percentile method)."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

Interval = tuple[float, float]

_RESAMPLES, _SHARE = 1000, 0.95


def interval(count: int, statistic: Callable[[NDArray[np.intp]], float | None]) -> Interval | None:
    """The 95 % interval of a statistic of `count` images, which are independent of each other, as
    the instruments of one image are not.

    statistic: of images with these numbers, drawn with replacement; None where it is undefined.
    None if the statistic is undefined in all resamples.
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
