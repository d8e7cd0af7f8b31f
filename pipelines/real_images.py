"""Stage `real_images`: images with boxes but no poses, the user's or a rendered stand-in."""

import logging
from dataclasses import asdict
from pathlib import Path

from shaftpose.dataset.coco import read_coco
from shaftpose.dataset.real_folder import PARTS, copy_real
from shaftpose.farm.locks import alone_in
from shaftpose.farm.stand_in import write_stand_in
from shaftpose.handovers import AboutReal
from shaftpose.json_files import write_json
from shaftpose.settings.stage import stage
from shaftpose.settings.tree import Settings

SCRATCH = Path("data/scratch")


@stage
def main(settings: Settings) -> None:
    """Write `images/`, `train.json`, `test.json` and `about.json` to `out`."""
    out, source, size = settings.out, settings.real_source, settings.size
    domain = "stand-in" if source is None else "real"
    with alone_in(out, SCRATCH):
        out.mkdir(parents=True, exist_ok=True)
        if source is None:
            write_stand_in(settings.stand_in, size, settings.seed, settings.cluster, SCRATCH, out)
        else:
            copy_real(source, out)
        write_json(out / "about.json", asdict(AboutReal(domain)))
    counts = {part: len(read_coco(out / f"{part}.json")) for part in PARTS}
    logging.getLogger(__name__).info("%s images %s are in %s", domain, counts, out)


if __name__ == "__main__":
    main()
