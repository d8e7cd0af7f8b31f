"""Stage `real_images`: images with boxes but no poses, the user's or a rendered stand-in."""

import logging
from dataclasses import asdict
from pathlib import Path

from shaftpose.core.files import write_json
from shaftpose.dataset.coco_folder import copy_folder, read_folder, summary, write_stand_in
from shaftpose.farm.locks import alone_in
from shaftpose.farm.render_sets import render_sets
from shaftpose.rendering.stand_in_sets import stand_in_sets
from shaftpose.settings.stage import stage
from shaftpose.settings.tree import Settings, warn_of_unread_images
from shaftpose.stage_files import REAL, STAND_IN, AboutImages

SCRATCH = Path("data/scratch")


@stage
def main(settings: Settings) -> None:
    """Write `images/`, the COCO files of the parts and `about.json` to `out`."""
    out, source, rendered = settings.out, settings.real.source, SCRATCH / "stand-in"
    with alone_in(out, SCRATCH):
        out.mkdir(parents=True, exist_ok=True)
        if source is None:
            with alone_in(rendered, SCRATCH):  # another run would overwrite its backgrounds
                sets = stand_in_sets(settings.stand_in, settings.size, settings.seed, rendered)
                render_sets(sets, settings.cluster, SCRATCH, rendered)
                write_stand_in(rendered, out)
        else:
            copy_folder(source, out)
        write_json(out / "about.json", asdict(AboutImages(REAL if source else STAND_IN)))
    for part, images in read_folder(out).items():
        logging.getLogger(__name__).info("%s/%s.json: %s", out, part, summary(images))
    warn_of_unread_images(settings, Path(__file__).resolve().parents[1])


if __name__ == "__main__":
    main()
