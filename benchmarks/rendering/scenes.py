"""The scenes of a set's first images."""

from dataclasses import dataclass
from pathlib import Path

from benchmarks.rendering.common import in_processes, quiet_generator
from shaftpose.rendering.rendered_set import RenderedSet
from shaftpose.rendering.scene import Scene
from shaftpose.rendering.scene_sampler import SceneSampler
from shaftpose.settings.parsing import to_json
from shaftpose.stage_files import read_stage_file

_FILE = "scenes.json"


@dataclass(frozen=True)
class FirstScenes:
    """The scenes of images 0 .. count - 1 of a set."""

    scenes: tuple[Scene, ...]


@dataclass(frozen=True)
class _Task:
    rendered: RenderedSet
    count: int


def write_first_scenes(rendered: RenderedSet, count: int, folder: Path) -> None:
    """Find and write the scenes in a subprocess, for a caller with another Blender scene."""
    (found,) = in_processes(_first_scenes, [_Task(rendered, count)], at_once=1)
    (folder / _FILE).write_text(to_json(FirstScenes(found)))


def read_first_scenes(folder: Path) -> tuple[Scene, ...]:
    """The scenes that `write_first_scenes` wrote to a folder."""
    return read_stage_file(folder / _FILE, FirstScenes, "write it again").scenes


def _first_scenes(task: _Task) -> tuple[Scene, ...]:
    """The draw that the generator accepts for each image; it may reject the first."""
    rendered = task.rendered
    sampler = SceneSampler(rendered.settings, tuple(rendered.backgrounds), rendered.seed)
    scenes = []
    with quiet_generator(rendered) as generator:
        for index in range(task.count):
            shafts = tuple(shaft.pose for shaft in generator.sample(index).instruments)
            draws = sampler.candidates(index)
            scenes.append(next(scene for scene in draws if scene.shafts == shafts))
    return tuple(scenes)
