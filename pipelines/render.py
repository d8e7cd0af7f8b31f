"""Stage `render`: the training images, and the clear and occluded test sets of Table II."""

import logging
from math import ceil
from pathlib import Path

from settings import cluster_settings, render_settings, size
from stage import SCRATCH, Config, stage

from shaftpose.backgrounds.library import Background, hold_out, read_library
from shaftpose.config import Size
from shaftpose.rendering.bop_models import write_models
from shaftpose.rendering.cluster import connect
from shaftpose.rendering.jobs import RenderedSet
from shaftpose.rendering.locks import alone_in
from shaftpose.rendering.scale_out import render_set
from shaftpose.rendering.shapes import instrument_shape

logger = logging.getLogger(__name__)

# What sets without occluders replace of the user's scene.
CLEAR = {"occluder_probability": 0.0, "crossing_probability": 0.0}
# What sets with hidden shafts replace: of each shaft a fifth is hidden at least, so that the image
# is not a clear one by chance, and a fifth is seen. A crossing shaft would stand before its lump.
OCCLUDED = {
    "occluder_probability": 1.0,
    "occluder_coverage": [0.2, 0.8],
    "crossing_probability": 0.0,
}
# Seeds of the sets, relative to that of the project: no image is in two of them.
SET_SEEDS = {"images": 0, "clear": 1_000_001, "occluded": 1_000_002}


@stage
def main(config: Config) -> None:
    """Write `images/`, `clear/`, `occluded/` and `models/` to `out`."""
    out = Path(config["out"])
    with alone_in(out, SCRATCH):  # or another run could begin while this one is between two sets
        render_images(config, out)
        write_instrument(config, out / "models")


def render_images(config: Config, out: Path) -> None:
    """Render each set into the folder of `out` that has its name."""
    library = read_library(Path("data/backgrounds"))
    cluster = cluster_settings(config)
    with connect(cluster) as client:
        for name, rendered in rendered_sets(config, library).items():
            render_set(rendered, SCRATCH, out / name, client, cluster.hang_s)
            logger.info("%d images are in %s", rendered.images, out / name)


def write_instrument(config: Config, folder: Path) -> None:
    """Write the mesh that goes with all sets, as BOP's tools expect it."""
    write_models(folder, instrument_shape(render_settings(config).shaft))


def rendered_sets(config: Config, library: list[Background]) -> dict[str, RenderedSet]:
    """The sets by name. The user's occluder probability is that of `images`: `clear` has neither
    occluders nor crossing shafts, `occluded` an occluder that hides a fair part of each shaft."""
    sizes = size(config)
    kept, held = hold_out(library, config["backgrounds"]["held_out"], config["seed"])
    clear = render_settings(config, scene=CLEAR)
    occluded = render_settings(config, scene=OCCLUDED)
    sets = {
        "images": (render_settings(config), kept, sizes.images),
        "clear": (clear, held, sizes.test_set),
        "occluded": (occluded, held, sizes.test_set),
    }
    return {
        name: RenderedSet(
            settings=settings,
            backgrounds=by_path(backgrounds),
            seed=config["seed"] + SET_SEEDS[name],
            images=images,
            images_per_shard=images_per_shard(images, sizes),
        )
        for name, (settings, backgrounds, images) in sets.items()
    }


def images_per_shard(images: int, sizes: Size) -> int:
    """Images per shard of a set: the profile's, or half of the set if that is less."""
    # A shard is the work of one process: two shards let a small set use two cores. The rule does
    # not ask how many cores there are, for the shards must not depend on the machine.
    return min(sizes.images_per_shard, ceil(images / 2))


def by_path(backgrounds: list[Background]) -> dict[Path, str]:
    """Background file -> id of its source."""
    return {background.path: background.source for background in backgrounds}


if __name__ == "__main__":
    main()
