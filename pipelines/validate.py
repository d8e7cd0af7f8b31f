"""Stage `validate`: checks of every rendered image, and a data card of the sets."""

import logging
from pathlib import Path

from shaftpose.checks.data_card_files import write_data_card
from shaftpose.checks.expected_sets import expected_sets
from shaftpose.checks.set_checks import check_sets
from shaftpose.core.background_index import read_library
from shaftpose.core.files import write_json
from shaftpose.rendering.image_sets import rendered_sets
from shaftpose.settings.stage import stage
from shaftpose.settings.tree import Settings

BACKGROUNDS, RENDERED = Path("data/backgrounds"), Path("data/render")


@stage
def main(settings: Settings) -> None:
    """Write the data card to `out`, and the source of each image's background to `results`."""
    library, held_out = read_library(BACKGROUNDS), settings.backgrounds.held_out
    sets = rendered_sets(settings.rendering, settings.size, library, held_out, settings.seed)
    checked = check_sets(expected_sets(sets, RENDERED), settings.cluster.workers)
    write_data_card(checked, settings.rendering, RENDERED / "images", settings.out)
    sources = {image.key: image.source for image in checked["images"]}
    write_json(settings.results / "sources.json", sources)
    for name, images in checked.items():
        logging.getLogger(__name__).info("%s: %d valid images", RENDERED / name, len(images))


if __name__ == "__main__":
    main()
