"""Shared parts of the rendering benchmark: the rendered set and subprocesses."""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from shaftpose.backgrounds.library import write_backgrounds
from shaftpose.core.background_index import read_library
from shaftpose.farm.blender_process import start_generator
from shaftpose.rendering.image_sets import by_path
from shaftpose.rendering.rendered_set import RenderedSet
from shaftpose.settings.compose import composed_settings
from shaftpose.settings.schema import BackgroundSettings
from shaftpose.settings.tree import Settings

if TYPE_CHECKING:
    from shaftpose.rendering.generator import SampleGenerator

ROOT = Path(__file__).parents[2]
SCRATCH = ROOT / "data/scratch/bench"
PROFILE = "demo"
SAMPLES = 6  # per pixel; fixed, so that results of all versions compare
SEED = 2020
_SOURCES, _VARIATIONS = 25, 4

Argument = TypeVar("Argument")
Result = TypeVar("Result")


def default_settings() -> Settings:
    """The settings of params.yaml with the benchmark's profile."""
    return composed_settings(ROOT, f"profile={PROFILE}")


def default_set() -> RenderedSet:
    """The default settings at `SAMPLES`, with procedural backgrounds; each part sets the number of
    images."""
    settings = default_settings()
    rendering = replace(settings.rendering, device="cpu")
    backgrounds = _backgrounds(settings.backgrounds, rendering.camera.size_px)
    rendered = RenderedSet(rendering, backgrounds, SEED, images=1, images_per_shard=1)
    return with_samples(rendered, SAMPLES)


def with_samples(rendered: RenderedSet, samples: int) -> RenderedSet:
    """The set with this number of samples per pixel in all images."""
    return replace(rendered, settings=replace(rendered.settings, samples=(samples, samples)))


def _backgrounds(settings: BackgroundSettings, size_px: int) -> dict[Path, str]:
    """Backgrounds, file -> id of its source; regenerated each time with the same bytes."""
    out = SCRATCH / "backgrounds"
    write_backgrounds(replace(settings, source=None), _SOURCES, _VARIATIONS, size_px, SEED, out)
    return by_path(read_library(out))


def in_processes(
    function: Callable[[Argument], Result], arguments: Iterable[Argument], at_once: int
) -> list[Result]:
    """`function` of each argument, each in a new process: Blender holds one scene per process and
    hangs in a fork."""
    with ProcessPoolExecutor(at_once, get_context("spawn"), max_tasks_per_child=1) as pool:
        return list(pool.map(function, arguments))


@contextmanager
def quiet_generator(rendered: RenderedSet) -> Iterator["SampleGenerator"]:
    """The generator of a set, for one process; hides Blender's output."""
    generator = start_generator(rendered)
    # Imported only here: a parent process must not load Blender.
    from shaftpose.rendering.silhouette import blender_output_hidden

    with blender_output_hidden():
        yield generator
