"""The figure of the ablation: bars of all variants next to the paper's values."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from shaftpose.figures.style import COLOURS, SOFT, finish, legend, new_figure
from shaftpose.metrics.table import MetricValues, metrics_of
from shaftpose.report.ablation import VariantRow

PANELS = metrics_of("detection", "pose")


def ablation_figure(
    rows: Sequence[VariantRow], constant: MetricValues, domain_label: str
) -> Figure:
    """Bars of each variant's metrics, with the paper's values and the constant predictor's."""
    figure = new_figure(12.0, 2.2 + 1.05 * len(rows))
    panels = figure.subplots(-(-len(PANELS) // 3), 3, sharey=True).ravel()
    for unused in panels[len(PANELS) :]:
        unused.remove()
    for axes, metric in zip(panels, PANELS, strict=False):
        _draw_ablation(axes, metric.name, rows, constant)
        finish(axes, metric.label, "")
        axes.grid(visible=False, axis="y")
    titles = [row.shown_title(domain_label) for row in rows]
    panels[0].set_yticks(range(len(rows)), titles)
    panels[0].set_ylim(len(rows) - 0.45, -0.55)  # the first variant on top
    legend(figure, panels[0])
    return figure


def _draw_ablation(
    axes: Axes, name: str, rows: Sequence[VariantRow], constant: MetricValues
) -> None:
    values = [_number(row.metrics.get(name)) for row in rows]
    axes.barh(range(len(rows)), values, height=0.55, color=COLOURS[0], label="ours")
    paper = [_number(getattr(row.paper, name, None)) for row in rows]
    axes.plot(
        paper,
        range(len(rows)),
        linestyle="",
        marker="D",
        markersize=7,
        label="paper",
        color=COLOURS[1],
        markeredgecolor="white",
    )
    level = _number(constant.get(name))
    if np.isfinite(level):
        axes.axvline(
            level, color=SOFT, linestyle="--", label="constant predictor (all instruments)"
        )
    axes.set_xlim(left=0)
    for index in np.flatnonzero(np.isnan(values)):  # a missing bar would look like an error of 0
        _say_missing(axes, beside=0.0 if np.isnan(paper[index]) else paper[index], row=index)


def _say_missing(axes: Axes, beside: float, row: int) -> None:
    """Mark a missing value of ours, in the colour of our bars."""
    axes.annotate(
        "n/a", (beside, row), xytext=(7, 0), textcoords="offset points",
        color=COLOURS[0], fontsize=9, va="center",
    )  # fmt: skip


def _number(value: float | int | None) -> float:
    """The value as a float; matplotlib omits NaN."""
    return float("nan") if value is None else float(value)
