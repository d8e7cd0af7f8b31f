"""Stage `render`: the training images, and the clear and occluded test sets of Table II."""

import logging
from pathlib import Path

from settings import render_settings, size
from stage import Config, stage

from shaftpose.backgrounds.library import Background, hold_out, read_library
from shaftpose.rendering.jobs import RenderedSet
from shaftpose.rendering.meshes import shaft_mesh
from shaftpose.rendering.scale_out import render_set
from shaftpose.shards import write_models

logger = logging.getLogger(__name__)

# Seeds of the sets, relative to that of the project: no image is in two of them.
SET_SEEDS = {"images": 0, "clear": 1_000_001, "occluded": 1_000_002}


@stage
def main(config: Config) -> None:
    """Write `images/`, `clear/`, `occluded/` and `models/` to `out`."""
    sizes, out = size(config), Path(config["out"])
    library = read_library(Path("data/backgrounds"))
    kept, held = hold_out(library, config["backgrounds"]["held_out"], config["seed"])
    plain = render_settings(config)
    hidden = render_settings(config, scene={"occluder_probability": 1.0})
    sets = {
        "images": (plain, kept, sizes.images),
        "clear": (plain, held, sizes.test_set),
        "occluded": (hidden, held, sizes.test_set),
    }
    for name, (settings, backgrounds, images) in sets.items():
        rendered = RenderedSet(
            settings=settings,
            backgrounds=by_path(backgrounds),
            seed=config["seed"] + SET_SEEDS[name],
            images=images,
            images_per_shard=sizes.images_per_shard,
        )
        render_set(rendered, Path("data/scratch"), out / name, config["render"]["workers"])
        logger.info("%d images are in %s", images, out / name)
    mesh = shaft_mesh(plain.shaft.diameter_mm, plain.shaft.length_mm)
    write_models(
        out / "models", mesh.vertices, mesh.faces, plain.shaft.diameter_mm, plain.shaft.length_mm
    )


def by_path(backgrounds: list[Background]) -> dict[Path, str]:
    """Background file -> id of its source."""
    return {background.path: background.source for background in backgrounds}


if __name__ == "__main__":
    main()
