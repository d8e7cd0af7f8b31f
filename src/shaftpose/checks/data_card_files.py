"""Writes the data card of checked sets, with histograms and a sheet of images."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from shaftpose.checks.checked_image import CheckedImage
from shaftpose.checks.data_card import QUANTITIES, quantities, ranges, statistics, to_markdown
from shaftpose.core.files import new_file, write_json
from shaftpose.core.geometry import Array
from shaftpose.core.images import write_jpeg
from shaftpose.core.shards import ShardedDataset
from shaftpose.figures.drawing import contact_sheet, draw_sample, evenly_spaced
from shaftpose.figures.style import COLOURS, finish, legend, new_figure, save_figure
from shaftpose.settings.schema import RenderSettings

DRAWN_IMAGES, COLUMNS, BINS = 20, 5, 30


def write_data_card(
    checked: Mapping[str, Sequence[CheckedImage]], settings: RenderSettings, images: Path, out: Path
) -> None:
    """Write `data_card.md`, `metrics.json` and `figures/` to `out`.

    images: folder of the set that the pictures show.
    """
    card = {name: statistics(images_of) for name, images_of in checked.items()}
    pictures = draw(checked["images"], settings, images, out)
    write_json(out / "metrics.json", card)
    with new_file(out / "data_card.md") as part:
        part.write_text(to_markdown(card, ranges(settings), pictures))


def draw(
    checked: Sequence[CheckedImage], settings: RenderSettings, images: Path, out: Path
) -> dict[str, str]:
    """Draw histograms and a sheet of training images; returns title -> file in `out`."""
    pictures = {"Distributions": "figures/distributions.png", "Images": "figures/images.jpg"}
    limits, values = ranges(settings), quantities(checked)
    panels = [
        Distribution(label, counted, values[name], limits.get(name))
        for counted, labels in QUANTITIES.items()
        for name, label in labels.items()
        if len(values[name])
    ]
    save_figure(distribution_figure(panels), out / pictures["Distributions"])
    shards = ShardedDataset(images)
    keys = evenly_spaced(shards.keys, DRAWN_IMAGES)
    sheet = contact_sheet([draw_sample(shards, key) for key in keys], COLUMNS)
    write_jpeg(sheet, out / pictures["Images"], quality=88)
    return pictures


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
