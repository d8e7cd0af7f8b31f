"""Figures of the accuracy on a test set: precision and recall, and pose errors."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from shaftpose.core.instruments import POSE_DIMENSIONS
from shaftpose.figures.style import (
    COLOURS,
    INK,
    SOFT,
    finish,
    legend,
    line_style,
    new_figure,
)
from shaftpose.metrics.detection.matching import Array
from shaftpose.metrics.detection.precision_recall import PrecisionRecall, average_precision
from shaftpose.metrics.pose_errors import PoseErrors
from shaftpose.metrics.table import metrics_named

POSE_LABELS = [metric.heading.lower() for metric in metrics_named(*POSE_DIMENSIONS)]
BINS = 12


def precision_recall_figure(curves: Mapping[str, PrecisionRecall]) -> Figure:
    """Precision against recall, one line for each title."""
    figure = new_figure(11.0, 5.4)
    axes = figure.subplots()
    for index, (title, curve) in enumerate(curves.items()):
        label = f"{title} (AP {average_precision(curve):.3f})"
        axes.plot(curve.recall, curve.precision, label=label, **line_style(index))
    axes.set(xlim=(0, 1.02), ylim=(0, 1.02))
    finish(axes, "recall", "precision")
    legend(figure, axes)
    return figure


def pose_error_figure(errors: PoseErrors) -> Figure:
    """Absolute error by true value, and its histogram, for each dimension of the pose."""
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


def error_over_bound_figure(errors: PoseErrors, bounds: Array) -> Figure:
    """Absolute errors divided by their Cramer-Rao bounds (M, 5), by true depth and pitch."""
    figure = new_figure(15.0, 5.8)
    panels = figure.subplots(2, len(POSE_LABELS))
    known = np.isfinite(bounds).all(axis=1)
    for row, dimension in enumerate((2, 3)):
        true = errors.true_poses[known, dimension]
        for axes, ratios, label in zip(
            panels[row], (errors.absolute[known] / bounds[known]).T, POSE_LABELS, strict=True
        ):
            _draw_quartiles(axes, true, ratios)
            finish(axes, f"true {POSE_LABELS[dimension]}", f"error / bound of {label.split()[0]}")
    legend(figure, panels[0, 0])
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
    """Counts up to the 99th percentile: a few outliers would hide all other errors."""
    if not len(absolute):
        _say_empty(axes)
        return
    limit = max(float(np.percentile(absolute, 99)), 1e-9)
    axes.hist(absolute, bins=30, range=(0, limit), color=COLOURS[0], alpha=0.85)
    mean = float(absolute.mean())
    axes.axvline(mean, color=COLOURS[1], linestyle="--", label=f"mean {mean:.2f}")
    axes.legend(frameon=False, fontsize=8, labelcolor=INK)


def _say_empty(axes: Axes) -> None:
    axes.text(0.5, 0.5, "no matched instrument", transform=axes.transAxes, color=SOFT, ha="center")
    axes.set(xticks=[], yticks=[])
