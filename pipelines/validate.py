"""Stage `validate`: every rendered image checked, and a card of what the sets consist of."""

import logging
from pathlib import Path

from render import rendered_sets
from results import write_json
from settings import cluster_settings, render_settings
from stage import Config, stage

from shaftpose.backgrounds.library import read_library
from shaftpose.config import RenderSettings, ShaftSettings
from shaftpose.dataset.data_card import QUANTITIES, quantities, ranges, statistics, to_markdown
from shaftpose.dataset.image_checks import Body
from shaftpose.dataset.image_facts import ImageFacts
from shaftpose.dataset.set_checks import ExpectedSet, check_sets
from shaftpose.deployment.overlay import contact_sheet, draw_sample, spread
from shaftpose.evaluation.distributions import Distribution, distribution_figure
from shaftpose.evaluation.figure_style import save_figure
from shaftpose.files import new_file
from shaftpose.images import write_jpeg
from shaftpose.rendering.shapes import instrument_shape
from shaftpose.shards import ShardedDataset

logger = logging.getLogger(__name__)

RENDERED = Path("data/render")
DRAWN_IMAGES, COLUMNS = 20, 5


@stage
def main(config: Config) -> None:
    """Write the card to `out`, and to `results`, for the split, the source of each background."""
    out, settings = Path(config["out"]), render_settings(config)
    checked = check_sets(expected_sets(config), cluster_settings(config).workers)
    card = {name: statistics(images) for name, images in checked.items()}
    pictures = draw(checked["images"], settings, out)
    write_json(out / "metrics.json", card)
    with new_file(out / "data_card.md") as part:
        part.write_text(to_markdown(card, ranges(settings), pictures))
    sources = {image.key: image.source for image in checked["images"]}
    write_json(Path(config["results"]) / "sources.json", sources)
    for name, images in checked.items():
        logger.info("%s: %d images are as they should be", RENDERED / name, len(images))
    logger.info("data card: %s", out / "data_card.md")


def expected_sets(config: Config) -> dict[str, ExpectedSet]:
    """What the render stage was to make, by set."""
    sets = rendered_sets(config, read_library(Path("data/backgrounds")))
    return {
        name: ExpectedSet(
            folder=RENDERED / name,
            settings=rendered.settings,
            body=body(rendered.settings.shaft),
            seed=rendered.seed,
            shards={
                shard.path.name: range(shard.first, shard.first + shard.count)
                for shard in rendered.shards(RENDERED / name)
            },
            backgrounds={path.name: source for path, source in rendered.backgrounds.items()},
        )
        for name, rendered in sets.items()
    }


def body(shaft: ShaftSettings) -> Body:
    """The instrument that the settings describe, as the checks know it."""
    shape = instrument_shape(shaft)
    return Body(shape.diameter_mm, shape.length_mm, shape.is_rod)


def draw(images: list[ImageFacts], settings: RenderSettings, out: Path) -> dict[str, str]:
    """Histograms and a sheet of the training images: title -> file in `out`."""
    pictures = {"Distributions": "figures/distributions.png", "Images": "figures/images.jpg"}
    limits, values = ranges(settings), quantities(images)
    panels = [
        Distribution(label, counted, values[name], limits.get(name))
        for counted, labels in QUANTITIES.items()
        for name, label in labels.items()
        if len(values[name])
    ]
    save_figure(distribution_figure(panels), out / pictures["Distributions"])
    shards = ShardedDataset(RENDERED / "images")
    keys = spread(shards.keys, DRAWN_IMAGES)
    sheet = contact_sheet([draw_sample(shards, key) for key in keys], COLUMNS)
    write_jpeg(sheet, out / pictures["Images"], quality=88)
    return pictures


if __name__ == "__main__":
    main()
