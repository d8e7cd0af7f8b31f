"""Stage `split`: which rendered images train, validate and test."""

import logging
from pathlib import Path

from results import read_result
from stage import Config, stage

from shaftpose.config import SplitSettings, parse
from shaftpose.dataset.split import split_images, write_split

logger = logging.getLogger(__name__)


@stage
def main(config: Config) -> None:
    """Write `train.csv`, `validation.csv` and `test.csv` to `out`."""
    settings = parse(SplitSettings, config["split"], "params.yaml: split")
    sources = read_result(Path("data/validation/sources.json"), "validate")
    split = split_images(sources, settings, config["seed"])
    out = Path(config["out"])
    write_split(split, out)
    if split.left_out:
        logger.warning(
            "%d images are in no part: their backgrounds are those of test images; "
            "more backgrounds leave fewer out", len(split.left_out),
        )  # fmt: skip
    logger.info(
        "%d images train, %d validate and %d test; the lists are in %s",
        len(split.train), len(split.validation), len(split.test), out,
    )  # fmt: skip


if __name__ == "__main__":
    main()
