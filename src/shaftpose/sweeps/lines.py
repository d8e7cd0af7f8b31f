"""A sweep as parallel coordinates: each job is a line through its settings and metrics."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from shaftpose.figures.style import GRID, INK, new_figure
from shaftpose.sweeps.jobs import (
    NO_VALUE,
    SweepJob,
    in_order,
    shortened,
    swept_parameters,
    values_of,
)

# Heights of the lowest and the highest value on an axis of height 1, and of the highest value of a
# metric that some jobs lack: `-` is above it.
_LOWEST, _HIGHEST, _HIGHEST_KNOWN = 0.04, 0.96, 0.84
# Keeps lines from crossing text.
_CLEAR = {"facecolor": "white", "edgecolor": "none", "pad": 1.0}


def line_figure(jobs: Sequence[SweepJob], metrics: Sequence[str]) -> Figure:
    """A line for each job, coloured by the first metric (0 if missing), the worst drawn first.

    Values are equally spaced on axes of parameters and to scale on axes of metrics; missing values
    are `-`, on top.
    """
    parameters = swept_parameters(jobs)
    figure = new_figure(2.6 * (len(parameters) + len(metrics)), 5.0)
    axes = figure.subplots()
    columns = [_levels(axes, n, values_of(jobs, name), name)
               for n, name in enumerate(parameters)]  # fmt: skip
    columns += [_scale(axes, n, [j.metrics.get(name) for j in jobs], name)
                for n, name in enumerate(metrics, len(parameters))]  # fmt: skip
    heights = np.stack(columns, axis=1)
    goal = np.array([job.metrics.get(metrics[0], 0.0) for job in jobs])
    colours = colormaps["viridis"](0.9 * Normalize()(goal))
    for job in np.argsort(goal):
        style = {"color": colours[job], "linewidth": 1.8, "marker": "o"}
        axes.plot(range(heights.shape[1]), heights[job], **style)
    axes.set_xlim(-0.3, heights.shape[1] - 0.4)
    axes.set_ylim(-0.06, 1.14)
    axes.set_axis_off()
    return figure


def _levels(axes: Axes, column: int, values: Sequence[str], name: str) -> np.ndarray:
    """Heights (N,) of a parameter's values, equally spaced in sorted order."""
    known = in_order(values)
    heights = dict(zip(known, np.linspace(_LOWEST, _HIGHEST, len(known)), strict=True))
    _draw_axis(axes, column, name, {float(height): value for value, height in heights.items()})
    return np.array([heights[value] for value in values])


def _scale(axes: Axes, column: int, values: Sequence[float | None], name: str) -> np.ndarray:
    """Heights (N,) of a metric's values, to scale between minimum and maximum."""
    known = [value for value in values if value is not None]
    complete = len(known) == len(values)
    low, high = min(known, default=0.0), max(known, default=0.0)
    unit = ((_HIGHEST if complete else _HIGHEST_KNOWN) - _LOWEST) / (high - low or 1.0)

    def height(value: float | None) -> float:
        return _HIGHEST if value is None else _LOWEST + unit * (value - low)

    marked = (low, (low + high) / 2, high) if known else ()
    marks = {height(value): f"{value:.3g}" for value in marked}
    _draw_axis(axes, column, name, marks if complete else marks | {_HIGHEST: NO_VALUE})
    return np.array([height(value) for value in values])


def _draw_axis(axes: Axes, column: int, name: str, marks: Mapping[float, str]) -> None:
    """Draw an axis; marks: height -> text."""
    axes.plot([column, column], [0, 1], color=GRID, linewidth=1.2, zorder=0)
    axes.text(column, 1.05, name, ha="center", color=INK, fontsize=10)
    for height, text in marks.items():
        shown = shortened(text)
        axes.text(column + 0.04, height, shown, va="center", color=INK, fontsize=8.5, bbox=_CLEAR)
