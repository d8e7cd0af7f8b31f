"""Numbers as the cells of a table."""

import math
from collections.abc import Iterable, Sequence

from shaftpose.metrics.summary import Interval
from shaftpose.metrics.table import Metric, MetricValues

MISSING = "n/a"


def show(value: float | int | None, digits: int) -> str:
    """A number with thousands separated, or "n/a" if it is missing or not finite."""
    if value is None or not math.isfinite(value):
        return MISSING
    return f"{value:,.{digits}f}"


def show_interval(ends: Interval | None, digits: int) -> str:
    """An interval, such as "0.91 to 0.95"."""
    return MISSING if ends is None else f"{show(ends[0], digits)} to {show(ends[1], digits)}"


def show_span(values: Iterable[float | None]) -> str:
    """A single value, or the range of several, such as "900 to 1,100"."""
    known = sorted({value for value in values if value is not None})
    if not known:
        return MISSING
    return " to ".join(_plain(value) for value in dict.fromkeys((known[0], known[-1])))


def _plain(value: float) -> str:
    return f"{value:,}" if isinstance(value, int) else f"{value:g}"


def headings(metrics: Sequence[Metric]) -> list[str]:
    """The headings of metrics."""
    return [metric.heading for metric in metrics]


def cells(
    values: MetricValues, metrics: Sequence[Metric], spread: MetricValues | None = None
) -> list[str]:
    """The values of metrics, with `±` and the spread where there is one."""
    shown = [show(values.get(one.name), one.digits) for one in metrics]
    if not spread:
        return shown
    return [
        f"{cell} ± {show(spread[one.name], one.digits)}" if one.name in spread else cell
        for cell, one in zip(shown, metrics, strict=True)
    ]


def paired(paper: Sequence[str] | None, ours: Sequence[str]) -> list[str]:
    """Cells with the paper's value first, or ours alone if the paper has no such row."""
    if paper is None:
        return list(ours)
    return [f"{theirs} / {own}" for theirs, own in zip(paper, ours, strict=True)]
