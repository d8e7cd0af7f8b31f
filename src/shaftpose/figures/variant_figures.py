"""Figures with all variants side by side: binned errors and learning curves."""

import math
from collections.abc import Mapping, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from shaftpose.figures.style import (
    COLOURS,
    finish,
    legend,
    line_style,
    new_figure,
)
from shaftpose.metrics.binned_errors import BIAS, BINS, ERRORS, ErrorBin
from shaftpose.metrics.table import metrics_named

Curves = Sequence[tuple[int, str, float]]  # rows of step, name and value of one training

QUANTITY_LABELS = {
    "z_mm": "true z [mm]",
    "pitch_deg": "true pitch [deg]",
    "yaw_from_seam_deg": "true yaw from the seam [deg]",
    "visible_fraction": "visible fraction",
    "border_px": "tip to border [px]",
}
FEWEST = 5  # instruments in a bin whose median is shown
ERROR_LABELS = {
    **{metric.name: metric.label.lower() for metric in metrics_named("tip_mm", "axis_deg")},
    BIAS: "signed z error [mm]",
}


def binned_error_figure(variants: Mapping[str, Mapping[str, Sequence[ErrorBin]]]) -> Figure:
    """Median error in each bin by variant title, with quantities as columns and errors as rows.

    A dotted line at 0 deg marks the seam of the yaw. Bins of fewer than `FEWEST` instruments are
    left out, and lines do not bridge them. Errors that older results lack have no row.
    """
    errors = [error for error in ERRORS if error != BIAS or _is_known(error, variants)]
    figure = new_figure(20.0, 3.2 * len(errors))
    panels = figure.subplots(len(errors), len(BINS), sharey="row")
    for row, error in zip(panels, errors, strict=True):
        for axes, quantity in zip(row, BINS, strict=True):
            for index, (title, bins) in enumerate(variants.items()):
                _draw_bins(axes, bins[quantity], error, title, index)
            if quantity == "yaw_from_seam_deg":
                axes.axvline(0.0, color=COLOURS[-1], linewidth=0.8, linestyle=":")
            finish(axes, QUANTITY_LABELS[quantity], f"median {ERROR_LABELS[error]}")
        if error == BIAS:
            for axes in row:
                axes.axhline(0.0, color=COLOURS[-1], linewidth=0.8)
        else:
            row[0].set_ylim(bottom=0)  # shared, and fixed from here on
    legend(figure, panels[0, 0])
    return figure


def _is_known(error: str, variants: Mapping[str, Mapping[str, Sequence[ErrorBin]]]) -> bool:
    bins = (one for quantities in variants.values() for row in quantities.values() for one in row)
    return any(getattr(one, error) is not None for one in bins)


def _draw_bins(axes: Axes, bins: Sequence[ErrorBin], value: str, title: str, index: int) -> None:
    axes.plot(
        [(one.low + one.high) / 2 for one in bins],
        [getattr(one, value) if one.count >= FEWEST else math.nan for one in bins],
        label=title,
        marker="o",
        markersize=3.5,
        **line_style(index),
    )


def learning_curve_figure(trainings: Mapping[str, Sequence[Curves]]) -> Figure:
    """Learning curves by variant title: one panel per name, one line per training, one style per
    variant."""
    rows = [row for variant in trainings.values() for curves in variant for row in curves]
    names = list(dict.fromkeys(name for _, name, _ in rows))
    columns = min(3, max(1, len(names)))
    lines = -(-max(1, len(names)) // columns)
    figure = new_figure(5.0 * columns, 2.8 * lines + 0.5)
    panels = figure.subplots(lines, columns, squeeze=False).ravel()
    for axes, name in zip(panels, names, strict=False):
        for index, (title, variant) in enumerate(trainings.items()):
            _draw_curves(axes, name, variant, title, index)
        finish(axes, "step", name)
    for unused in panels[len(names) :]:
        unused.remove()
    legend(figure, panels[0])
    return figure


def _draw_curves(axes: Axes, name: str, variant: Sequence[Curves], title: str, index: int) -> None:
    for number, curves in enumerate(variant):
        points = sorted((step, value) for step, row_name, value in curves if row_name == name)
        steps, values = [step for step, _ in points], [value for _, value in points]
        # One legend entry for all of them.
        axes.plot(steps, values, label="" if number else title, **line_style(index))
