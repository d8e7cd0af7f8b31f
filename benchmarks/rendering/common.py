"""Shared parts of the rendering benchmark: the rendered set and subprocesses."""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import yaml

from shaftpose.backgrounds.library import procedural_sources, write_library
from shaftpose.backgrounds.tissue import MUCOSA
from shaftpose.backgrounds.variations import VariationRanges
from shaftpose.core.background_index import read_library
from shaftpose.farm.worker import start_generator
from shaftpose.rendering.rendered_set import RenderedSet
from shaftpose.settings.parsing import parse
from shaftpose.settings.parts import BackgroundSettings, RenderSettings

if TYPE_CHECKING:
    from shaftpose.rendering.generator import Generator

ROOT = Path(__file__).parents[2]
SCRATCH = ROOT / "data/scratch/bench"
PROFILE = "demo"  # its quality is the default
SEED = 2020
_SOURCES, _VARIATIONS = 25, 4

Argument = TypeVar("Argument")
Result = TypeVar("Result")


def parameters() -> dict[str, Any]:
    """The content of params.yaml."""
    values: dict[str, Any] = yaml.safe_load((ROOT / "params.yaml").read_text())
    return values


def default_set() -> RenderedSet:
    """The default settings with procedural backgrounds; each part sets the number of images."""
    values = parameters()
    size = yaml.safe_load((ROOT / "conf/profiles.yaml").read_text())[PROFILE]
    parts = {name: values[name] for name in ("camera", "poses", "shaft", "scene", "lens")}
    quality = {"samples": size["samples"], "jpeg_quality": values["render"]["jpeg_quality"]}
    settings = parse(RenderSettings, parts | quality, "params.yaml")
    backgrounds = _backgrounds(values, settings.camera.size_px)
    return RenderedSet(settings, backgrounds, SEED, images=1, images_per_shard=1)


def _backgrounds(values: dict[str, Any], size_px: int) -> dict[Path, str]:
    """Backgrounds, file -> id of its source; regenerated each time with the same bytes."""
    settings = parse(BackgroundSettings, values["backgrounds"], "params.yaml: backgrounds")
    ranges = VariationRanges(settings.hue_deg, settings.saturation, settings.brightness)
    sources, out = procedural_sources(_SOURCES, SEED, size_px, MUCOSA), SCRATCH / "backgrounds"
    write_library(sources, out, _VARIATIONS, ranges, SEED, size_px, _SOURCES)
    return {background.path: background.source for background in read_library(out)}


def in_processes(
    function: Callable[[Argument], Result], arguments: Iterable[Argument], at_once: int
) -> list[Result]:
    """`function` of each argument, each in a new process: Blender holds one scene per process and
    hangs in a fork."""
    with ProcessPoolExecutor(at_once, get_context("spawn"), max_tasks_per_child=1) as pool:
        return list(pool.map(function, arguments))


@contextmanager
def quiet_generator(rendered: RenderedSet) -> Iterator["Generator"]:
    """The generator of a set, for one process; hides Blender's output."""
    generator = start_generator(rendered)
    # Imported only here: a parent process must not load Blender.
    from shaftpose.rendering.silhouette import blender_output_hidden

    with blender_output_hidden():
        yield generator
