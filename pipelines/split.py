"""Stage `split`: the training, validation and test parts of the rendered images."""

import logging
from pathlib import Path

from shaftpose.core.files import read_json
from shaftpose.dataset.split import split_images, write_split
from shaftpose.settings.stage import stage
from shaftpose.settings.tree import Settings

logger = logging.getLogger(__name__)


@stage
def main(settings: Settings) -> None:
    """Write `train.csv`, `validation.csv` and `test.csv` to `out`."""
    sources = read_json(Path("data/validation/sources.json"), "run `dvc repro validate`")
    split = split_images(sources, settings.split, settings.seed)
    write_split(split, settings.out)
    if split.left_out:
        logger.warning(
            "%d images are left out, because they share backgrounds with test images; "
            "with more backgrounds there are fewer", len(split.left_out),
        )  # fmt: skip
    logger.info(
        "%d training, %d validation and %d test images; the lists are in %s",
        len(split.train), len(split.validation), len(split.test), settings.out,
    )  # fmt: skip


if __name__ == "__main__":
    main()
