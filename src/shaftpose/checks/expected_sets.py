"""Expected content of finished sets, from the jobs that rendered them."""

from collections.abc import Mapping
from pathlib import Path

from shaftpose.checks.image_checks import Body
from shaftpose.checks.set_checks import ExpectedSet
from shaftpose.rendering.rendered_set import RenderedSet
from shaftpose.rendering.shapes import instrument_shape
from shaftpose.settings.schema import ShaftSettings


def expected_sets(sets: Mapping[str, RenderedSet], folder: Path) -> dict[str, ExpectedSet]:
    """The expected content of each set, in the subfolder of its name."""
    return {
        name: ExpectedSet(
            folder=folder / name,
            settings=rendered.settings,
            body=_body(rendered.settings.shaft),
            seed=rendered.seed,
            shards={
                shard.path.name: range(shard.first, shard.first + shard.count)
                for shard in rendered.shards(folder / name)
            },
            backgrounds={path.name: source for path, source in rendered.backgrounds.items()},
        )
        for name, rendered in sets.items()
    }


def _body(shaft: ShaftSettings) -> Body:
    shape = instrument_shape(shaft)
    return Body(shape.diameter_mm, shape.length_mm, shape.is_rod)
