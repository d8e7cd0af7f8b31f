"""The report's figures: matplotlib `Figure` objects, without any global plotting state."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from shaftpose.evaluation import paper_tables
from shaftpose.evaluation.ablation import MetricValues, VariantRow, variant_title
from shaftpose.evaluation.average_precision import PrecisionRecall, average_precision
from shaftpose.evaluation.boxes import Array
from shaftpose.evaluation.figure_style import (
    COLOURS,
    INK,
    LINE_STYLES,
    SOFT,
    finish,
    legend,
    new_figure,
)
from shaftpose.evaluation.pose_errors import PoseErrors

POSE_LABELS = ("x [mm]", "y [mm]", "z [mm]", "pitch [deg]", "yaw [deg]")
BINS = 12
ABLATION_PANELS = {
    "mAP": "mAP",
    "detected_rate": "detected rate",
    "tip_mm": "tip error [mm]",
    "x_mm": "x error [mm]",
    "y_mm": "y error [mm]",
    "z_mm": "z error [mm]",
    "pitch_deg": "pitch error [deg]",
    "yaw_deg": "yaw error [deg]",
    "axis_deg": "axis error [deg]",
}


def precision_recall_figure(curves: Mapping[str, PrecisionRecall]) -> Figure:
    """Precision against recall, a line for each title."""
    figure = new_figure(11.0, 5.4)
    axes = figure.subplots()
    for index, (title, curve) in enumerate(curves.items()):
        label = f"{title} (AP {average_precision(curve):.3f})"
        axes.plot(curve.recall, curve.precision, label=label, **_line(index))
    axes.set(xlim=(0, 1.02), ylim=(0, 1.02))
    finish(axes, "recall", "precision")
    legend(figure, axes)
    return figure


def pose_error_figure(errors: PoseErrors) -> Figure:
    """For each dimension of the pose, the absolute error by true value and its histogram."""
    figure = new_figure(15.0, 5.8)
    panels = figure.subplots(2, len(POSE_LABELS))
    for dimension, label in enumerate(POSE_LABELS):
        absolute, true = errors.absolute[:, dimension], errors.true_poses[:, dimension]
        _draw_quartiles(panels[0, dimension], true, absolute)
        _draw_histogram(panels[1, dimension], absolute)
        finish(panels[0, dimension], f"true {label}", f"error of {label}")
        finish(panels[1, dimension], f"error of {label}, lowest 99 %", "instruments")
    legend(figure, panels[0, 0])
    return figure


def learning_curve_figure(curves: Mapping[str, Sequence[tuple[int, str, float]]]) -> Figure:
    """Rows (step, name, value) by variant title: a panel for each name, a line for each variant."""
    names = list(dict.fromkeys(name for rows in curves.values() for _, name, _ in rows))
    columns = min(3, max(1, len(names)))
    lines = -(-max(1, len(names)) // columns)
    figure = new_figure(5.0 * columns, 2.8 * lines + 0.5)
    panels = figure.subplots(lines, columns, squeeze=False).ravel()
    for axes, name in zip(panels, names, strict=False):
        _draw_learning(axes, name, curves)
        finish(axes, "step", name)
    for unused in panels[len(names) :]:
        unused.remove()
    legend(figure, panels[0])
    return figure


def ablation_figure(
    rows: Sequence[VariantRow], constant: MetricValues, domain_label: str
) -> Figure:
    """Bars of each variant's metrics, with the paper's values and the constant predictor's."""
    figure = new_figure(12.0, 2.2 + 1.05 * len(rows))
    panels = figure.subplots(3, 3, sharey=True).ravel()
    for axes, (name, label) in zip(panels, ABLATION_PANELS.items(), strict=True):
        _draw_ablation(axes, name, rows, constant)
        finish(axes, label, "")
        axes.grid(visible=False, axis="y")
    titles = [variant_title(row.variant, domain_label, row.title) for row in rows]
    panels[0].set_yticks(range(len(rows)), titles)
    panels[0].set_ylim(len(rows) - 0.45, -0.55)  # the first variant on top
    legend(figure, panels[0])
    return figure


def _draw_quartiles(axes: Axes, true: Array, absolute: Array) -> None:
    """Median line and quartile band over equally wide bins of the true value."""
    if not len(true):
        _say_empty(axes)
        return
    edges = np.linspace(true.min(), true.max(), BINS + 1)
    bins = np.digitize(true, edges[1:-1])
    filled = np.unique(bins)
    quartiles = [np.percentile(absolute[bins == index], (25, 50, 75)) for index in filled]
    low, median, high = np.transpose(quartiles)
    centres = (edges[filled] + edges[filled + 1]) / 2
    axes.fill_between(
        centres, low, high, color=COLOURS[0], alpha=0.2, linewidth=0, label="quartiles"
    )
    axes.plot(centres, median, color=COLOURS[0], marker="o", markersize=3.5, label="median")
    axes.set_ylim(bottom=0)


def _draw_histogram(axes: Axes, absolute: Array) -> None:
    """Counts up to the 99th percentile: a few gross errors would hide all others."""
    if not len(absolute):
        _say_empty(axes)
        return
    limit = max(float(np.percentile(absolute, 99)), 1e-9)
    axes.hist(absolute, bins=30, range=(0, limit), color=COLOURS[0], alpha=0.85)
    mean = float(absolute.mean())
    axes.axvline(mean, color=COLOURS[1], linestyle="--", label=f"mean {mean:.2f}")
    axes.legend(frameon=False, fontsize=8, labelcolor=INK)


def _draw_learning(
    axes: Axes, name: str, curves: Mapping[str, Sequence[tuple[int, str, float]]]
) -> None:
    for index, (title, rows) in enumerate(curves.items()):
        points = sorted((step, value) for step, row_name, value in rows if row_name == name)
        steps, values = [step for step, _ in points], [value for _, value in points]
        axes.plot(steps, values, label=title, **_line(index))


def _draw_ablation(
    axes: Axes, name: str, rows: Sequence[VariantRow], constant: MetricValues
) -> None:
    values = [_number(row.metrics.get(name)) for row in rows]
    axes.barh(range(len(rows)), values, height=0.55, color=COLOURS[0], label="ours")
    paper = [_number(getattr(paper_tables.TABLE_I.get(r.variant), name, None)) for r in rows]
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
        axes.axvline(level, color=SOFT, linestyle="--", label="constant predictor")
    axes.set_xlim(left=0)
    for index in np.flatnonzero(np.isnan(values)):  # no bar at all would look like no error
        _say_missing(axes, beside=0.0 if np.isnan(paper[index]) else paper[index], row=index)


def _say_missing(axes: Axes, beside: float, row: int) -> None:
    """That we have no value, in the colour of our bars."""
    axes.annotate(
        "n/a", (beside, row), xytext=(7, 0), textcoords="offset points",
        color=COLOURS[0], fontsize=9, va="center",
    )  # fmt: skip


def _number(value: float | int | None) -> float:
    """matplotlib leaves out what is not a number."""
    return float("nan") if value is None else float(value)


def _line(index: int) -> dict[str, Any]:
    style = LINE_STYLES[index % len(LINE_STYLES)]
    return {"color": COLOURS[index % len(COLOURS)], "linestyle": style}


def _say_empty(axes: Axes) -> None:
    axes.text(0.5, 0.5, "no matched instrument", transform=axes.transAxes, color=SOFT, ha="center")
    axes.set(xticks=[], yticks=[])
