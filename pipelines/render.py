"""Stage `render`: the training images, and the clear and occluded test sets of Table II."""

from pathlib import Path

from shaftpose.farm.locks import alone_in
from shaftpose.farm.render_sets import render_sets
from shaftpose.rendering.bop_models import write_models
from shaftpose.rendering.set_plans import planned_sets
from shaftpose.rendering.shapes import instrument_shape
from shaftpose.settings.stage import stage
from shaftpose.settings.tree import Settings

SCRATCH = Path("data/scratch")


@stage
def main(settings: Settings) -> None:
    """Write `images/`, `clear/`, `occluded/` and `models/` to `out`."""
    with alone_in(settings.out, SCRATCH):  # another run must not start between two sets
        held_out = settings.backgrounds.held_out
        sets = planned_sets(settings.rendering, settings.size, held_out, settings.seed)
        render_sets(sets, settings.cluster, SCRATCH, settings.out)
        write_models(settings.out / "models", instrument_shape(settings.shaft))


if __name__ == "__main__":
    main()
