"""Expected content of finished sets, from the jobs that rendered them."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from shaftpose.rendering.rendered_set import RenderedSet
from shaftpose.rendering.shapes import instrument_shape
from shaftpose.settings.schema import RenderSettings, ShaftSettings


@dataclass(frozen=True)
class Body:
    """The rod around the axis that contains the instrument, and whether the instrument is that
    rod."""

    diameter_mm: float
    length_mm: float
    is_rod: bool


@dataclass(frozen=True)
class ExpectedSet:
    """Expected content of a folder of shards.

    body: the instrument's; seed: of the images' random draws; shards: file name -> numbers of its
    images; backgrounds: file name -> id of its source.
    """

    folder: Path
    settings: RenderSettings
    body: Body
    seed: int
    shards: Mapping[str, range]
    backgrounds: Mapping[str, str]


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
