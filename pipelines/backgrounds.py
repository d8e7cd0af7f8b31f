"""Stage `backgrounds`: source images, real or procedural, and their colour variations."""

import logging
from pathlib import Path

from settings import size
from stage import Config, stage

from shaftpose.backgrounds.library import procedural_sources, read_source_images, write_library
from shaftpose.backgrounds.tissue import MUCOSA
from shaftpose.backgrounds.variations import VariationRanges
from shaftpose.config import BackgroundSettings, parse

logger = logging.getLogger(__name__)


@stage
def main(config: Config) -> None:
    """Write the background library to `out`."""
    settings = parse(BackgroundSettings, config["backgrounds"], "params.yaml: backgrounds")
    sizes, side_px, seed = size(config), config["camera"]["size_px"], config["seed"]
    out = Path(config["out"])
    ranges = VariationRanges(settings.hue_deg, settings.saturation, settings.brightness)
    if settings.source is None:
        logger.info("painting %d procedural tissues, no folder being given", sizes.sources)
        sources = procedural_sources(sizes.sources, seed, side_px, MUCOSA)
        write_library(sources, out, sizes.variations, ranges, seed, side_px, sizes.sources)
    else:
        images = read_source_images(Path(settings.source))
        write_library(images, out, sizes.variations, ranges, seed, side_px, len(images))
        logger.info("%d unreadable images were skipped", len(images.skipped))
    logger.info("the backgrounds are in %s", out)


if __name__ == "__main__":
    main()
