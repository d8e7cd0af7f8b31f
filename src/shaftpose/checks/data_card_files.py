"""Writes the data card of checked sets, with histograms and a sheet of images."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from shaftpose.checks.data_card import QUANTITIES, quantities, ranges, statistics, to_markdown
from shaftpose.checks.distributions import Distribution, distribution_figure
from shaftpose.checks.image_facts import ImageFacts
from shaftpose.core.files import new_file, write_json
from shaftpose.core.images import write_jpeg
from shaftpose.core.shards import ShardedDataset
from shaftpose.figures.drawing import contact_sheet, draw_sample, evenly_spaced
from shaftpose.figures.style import save_figure
from shaftpose.settings.schema import RenderSettings

DRAWN_IMAGES, COLUMNS = 20, 5


def write_data_card(
    checked: Mapping[str, Sequence[ImageFacts]], settings: RenderSettings, images: Path, out: Path
) -> None:
    """Write `data_card.md`, `metrics.json` and `figures/` to `out`.

    images: folder of the set that the pictures show.
    """
    card = {name: statistics(facts) for name, facts in checked.items()}
    pictures = draw(checked["images"], settings, images, out)
    write_json(out / "metrics.json", card)
    with new_file(out / "data_card.md") as part:
        part.write_text(to_markdown(card, ranges(settings), pictures))


def draw(
    facts: Sequence[ImageFacts], settings: RenderSettings, images: Path, out: Path
) -> dict[str, str]:
    """Draw histograms and a sheet of training images; returns title -> file in `out`."""
    pictures = {"Distributions": "figures/distributions.png", "Images": "figures/images.jpg"}
    limits, values = ranges(settings), quantities(facts)
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
