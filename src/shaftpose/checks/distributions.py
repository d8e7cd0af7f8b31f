"""Histograms of the quantities of a dataset, one panel each."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from shaftpose.core.geometry import Array
from shaftpose.figures.style import COLOURS, finish, legend, new_figure

COLUMNS, BINS = 5, 30


@dataclass(frozen=True)
class Distribution:
    """One panel: a quantity's label, the counted items, the values (N,), and the range that they
    were drawn from, if any."""

    label: str
    counted: str
    values: Array
    drawn_from: tuple[float, float] | None


def distribution_figure(panels: Sequence[Distribution]) -> Figure:
    """A histogram of each quantity; dashed lines mark the ends of its range."""
    rows = -(-len(panels) // COLUMNS)
    figure = new_figure(3.0 * COLUMNS, 2.4 * rows + 0.5)
    cells = figure.subplots(rows, COLUMNS, squeeze=False)
    for axes, panel in zip(cells.flat, panels, strict=False):
        _draw(axes, panel)
        finish(axes, panel.label, panel.counted)
    for unused in cells.flat[len(panels) :]:
        unused.remove()
    legend(figure, cells[0, 0])
    return figure


def _draw(axes: Axes, panel: Distribution) -> None:
    counts, _, _ = axes.hist(panel.values, bins=_bins(panel.values), color=COLOURS[0], alpha=0.85)
    if np.max(counts) > len(panel.values) / 2:  # this bin would dwarf the others
        axes.set_yscale("log")
    axes.locator_params(axis="x", nbins=5, steps=[1, 2, 5, 10])
    for end, label in zip(panel.drawn_from or (), ("drawn from", None), strict=False):
        axes.axvline(end, color=COLOURS[1], linestyle="--", label=label)


def _bins(values: Array) -> int | list[float]:
    """One bin for each of a few whole numbers: narrower bins would leave gaps."""
    if len(values) and np.ptp(values) < BINS and np.array_equal(values, np.rint(values)):
        return [float(edge) for edge in np.arange(values.min(), values.max() + 2) - 0.5]
    return BINS
