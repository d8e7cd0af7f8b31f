"""A sweep as parallel coordinates: each job a line through its settings and its metrics."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from shaftpose.evaluation.figure_style import GRID, INK, new_figure

_MARGIN = 0.04  # of an axis' height, free above and below its values


@dataclass(frozen=True)
class SweepJob:
    """One training of a sweep: its parameters as text and its last metrics, by name."""

    parameters: Mapping[str, str]
    metrics: Mapping[str, float]


def swept_parameters(jobs: Sequence[SweepJob]) -> list[str]:
    """The names of the parameters that are not the same in all jobs."""
    names = sorted({name for job in jobs for name in job.parameters})
    return [name for name in names if len({job.parameters.get(name) for job in jobs}) > 1]


def sweep_figure(jobs: Sequence[SweepJob], metrics: Sequence[str]) -> Figure:
    """A line for each job, coloured by the first metric, the worst drawn first.

    Axes of parameters have their values at equal distances, those of metrics are to scale.
    """
    parameters = swept_parameters(jobs)
    figure = new_figure(2.6 * (len(parameters) + len(metrics)), 5.0)
    axes = figure.subplots()
    columns = [_levels(axes, n, [j.parameters[name] for j in jobs], name)
               for n, name in enumerate(parameters)]  # fmt: skip
    columns += [_scale(axes, n, [j.metrics[name] for j in jobs], name)
                for n, name in enumerate(metrics, len(parameters))]  # fmt: skip
    heights = np.stack(columns, axis=1)
    goal = heights[:, len(parameters)]
    for job in np.argsort(goal):
        colour = colormaps["viridis"](0.9 * goal[job])
        axes.plot(range(heights.shape[1]), heights[job], color=colour, linewidth=1.8, marker="o")
    axes.set_xlim(-0.3, heights.shape[1] - 0.4)
    axes.set_ylim(-0.06, 1.14)
    axes.set_axis_off()
    return figure


def _levels(axes: Axes, column: int, values: Sequence[str], name: str) -> np.ndarray:
    """Heights (N,) of a parameter's values in the order of their size."""
    known = sorted(set(values), key=_order)
    heights = dict(zip(known, np.linspace(_MARGIN, 1 - _MARGIN, len(known)), strict=True))
    _draw_axis(axes, column, name, {value: float(height) for value, height in heights.items()})
    return np.array([heights[value] for value in values])


def _order(value: str) -> tuple[float, str]:
    """Numbers by size, all else behind them by its letters."""
    try:
        return float(value), ""
    except ValueError:
        return np.inf, value


def _scale(axes: Axes, column: int, values: Sequence[float], name: str) -> np.ndarray:
    """Heights (N,) of a metric's values between the least and the greatest."""
    low, high = min(values), max(values)
    span = high - low or 1.0
    heights = _MARGIN + (1 - 2 * _MARGIN) * (np.array(values) - low) / span
    middle = (low + high) / 2
    _draw_axis(axes, column, name, {f"{low:.3g}": _MARGIN, f"{middle:.3g}": 0.5,
                                    f"{high:.3g}": 1 - _MARGIN})  # fmt: skip
    return heights


def _draw_axis(axes: Axes, column: int, name: str, marks: Mapping[str, float]) -> None:
    axes.plot([column, column], [0, 1], color=GRID, linewidth=1.2, zorder=0)
    axes.text(column, 1.05, name, ha="center", color=INK, fontsize=10)
    for text, height in marks.items():
        axes.text(column + 0.04, height, text, va="center", color=INK, fontsize=8.5)
