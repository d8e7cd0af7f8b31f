"""Stage `render`: the training images, and the clear and occluded test sets of Table II."""

from pathlib import Path

from shaftpose.core.background_index import read_library
from shaftpose.farm.locks import alone_in
from shaftpose.farm.render_sets import render_sets
from shaftpose.rendering.bop_models import write_models
from shaftpose.rendering.handle_ends import warn_of_visible_ends
from shaftpose.rendering.image_sets import rendered_sets
from shaftpose.rendering.shapes import instrument_shape
from shaftpose.settings.stage import stage
from shaftpose.settings.tree import Settings

BACKGROUNDS, SCRATCH = Path("data/backgrounds"), Path("data/scratch")


@stage
def main(settings: Settings) -> None:
    """Write `images/`, `clear/`, `occluded/` and `models/` to `out`."""
    warn_of_visible_ends(settings.rendering)
    with alone_in(settings.out, SCRATCH):  # another run must not start between two sets
        library, held_out = read_library(BACKGROUNDS), settings.backgrounds.held_out
        sets = rendered_sets(settings.rendering, settings.size, library, held_out, settings.seed)
        # First, so that the mesh of a CAD file can be looked at before hours of rendering.
        write_models(settings.out / "models", instrument_shape(settings.shaft))
        render_sets(sets, settings.cluster, SCRATCH, settings.out)


if __name__ == "__main__":
    main()
