"""The figure of binned errors: all variants side by side."""

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

QUANTITY_LABELS = {
    "z_mm": "true z [mm]",
    "pitch_deg": "true pitch [deg]",
    "yaw_from_seam_deg": "true yaw from the seam [deg]",
    "visible_fraction": "visible fraction",
    "border_px": "tip to border [px]",
}
FEWEST = 5  # instruments in a bin whose median is shown
ERROR_LABELS = {
    "tip_mm": "tip error [mm]",
    "axis_deg": "axis error [deg]",
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
                _draw(axes, bins[quantity], error, title, index)
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


def _draw(axes: Axes, bins: Sequence[ErrorBin], value: str, title: str, index: int) -> None:
    axes.plot(
        [(one.low + one.high) / 2 for one in bins],
        [getattr(one, value) if one.count >= FEWEST else math.nan for one in bins],
        label=title,
        marker="o",
        markersize=3.5,
        **line_style(index),
    )
