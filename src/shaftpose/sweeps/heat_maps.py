"""A sweep over two settings as heat maps: one per metric, with one cell per job."""

from collections.abc import Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from shaftpose.figures.style import GRID, INK, finish, new_figure
from shaftpose.metrics.table import metrics_named
from shaftpose.sweeps.jobs import (
    SweepJob,
    in_order,
    shortened,
    swept_parameters,
    values_of,
)

NOTHING_RIGHT = "no correct\ndetection"
_CELL, _CHARACTER = 0.75, 0.085  # inches


def is_full_grid(jobs: Sequence[SweepJob]) -> bool:
    """Whether two settings were swept, and each pair of their values has one job."""
    swept = [values_of(jobs, name) for name in swept_parameters(jobs)]
    if len(swept) != 2:
        return False
    pairs = set(zip(*swept, strict=True))
    return len(pairs) == len(jobs) == len(set(swept[0])) * len(set(swept[1]))


def heat_map_figure(jobs: Sequence[SweepJob], metrics: Sequence[str]) -> Figure:
    """A row of heat maps, one for each metric, of jobs on a full grid.

    Lighter cells are better. The setting with the longer values is on the vertical axis.
    """
    across, up = sorted(swept_parameters(jobs), key=lambda name: _longest(_labels(jobs, name)))
    figure = _with_panels(_labels(jobs, across), _labels(jobs, up), len(metrics))
    for axes, metric in zip(figure.axes, metrics, strict=True):
        _draw_map(axes, _grid(jobs, metric, across, up), metric)
        finish(axes, across, up if axes is figure.axes[0] else "")
    return figure


def _labels(jobs: Sequence[SweepJob], name: str) -> list[str]:
    """The sorted values of a setting, as shown in the figure."""
    return [shortened(value) for value in in_order(values_of(jobs, name))]


def _longest(labels: Sequence[str]) -> int:
    return max(len(label) for label in labels)


def _with_panels(across: Sequence[str], up: Sequence[str], count: int) -> Figure:
    """A figure with `count` panels, and the labels of their columns and rows."""
    width = len(across) * max(_CELL, _CHARACTER * _longest(across))
    margin = 1.0 + _CHARACTER * _longest(up)
    figure = new_figure(margin + count * (width + 0.3), 1.3 + _CELL * len(up))
    first, *_ = figure.subplots(1, count, sharex=True, sharey=True, squeeze=False)[0]
    first.set_xticks(np.arange(len(across)) + 0.5, across)
    first.set_yticks(np.arange(len(up)) + 0.5, up)
    return figure


def _grid(jobs: Sequence[SweepJob], metric: str, across: str, up: str) -> np.ndarray:
    """A metric's values (rows, columns), NaN for jobs that lack it; settings are sorted."""
    columns, rows = values_of(jobs, across), values_of(jobs, up)
    values = [job.metrics.get(metric, np.nan) for job in jobs]
    found = dict(zip(zip(rows, columns, strict=True), values, strict=True))
    return np.array(
        [[found[row, column] for column in in_order(columns)] for row in in_order(rows)]
    )


def _draw_map(axes: Axes, grid: np.ndarray, metric: str) -> None:
    """Draw the cells of a `_grid` with their values, the first row at the bottom."""
    (row_of_table,) = metrics_named(metric.rpartition("/")[2])
    less = not row_of_table.higher_is_better
    colours = colormaps["viridis_r" if less else "viridis"].with_extremes(bad=GRID)
    cells = axes.pcolormesh(grid, cmap=colours, edgecolors="white", linewidth=2)
    title = f"{metric}\n{'lower' if less else 'higher'} is better"
    axes.set_title(title, color=INK, fontsize=10)
    for (row, column), value in np.ndenumerate(grid):
        dark = cells.to_rgba(value)[1] < 0.5  # in viridis, lighter colours have more green
        text = NOTHING_RIGHT if np.isnan(value) else f"{value:.{row_of_table.digits}f}"
        colour, size = "white" if dark else INK, 7.5 if np.isnan(value) else 9
        axes.text(
            column + 0.5, row + 0.5, text, color=colour, fontsize=size, ha="center", va="center"
        )
