"""Time profile of one image."""

from cProfile import Profile
from dataclasses import dataclass
from importlib import import_module
from operator import attrgetter
from pathlib import Path
from pstats import Stats
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

from benchmarks.rendering.common import (
    SAMPLES,
    SCRATCH,
    in_processes,
    quiet_generator,
    with_samples,
)
from shaftpose.core.shard_writer import ShardWriter, shard_name
from shaftpose.rendering.rendered_set import RenderedSet

# The functions of each step; their time includes everything they call.
STEPS = {
    "pose sampling": ["shaftpose.rendering.scene_sampler:SceneSampler.candidates"],
    "rendering": ["shaftpose.rendering.blender:Renderer.render"],
    "reading passes": ["shaftpose.rendering.cycles:_copy_passes"],
    "compositing": [
        "shaftpose.rendering.generator:read_background",
        "shaftpose.rendering.compositing:composite",
        "shaftpose.rendering.optics:apply_lens",
    ],
    "annotation": [
        "shaftpose.rendering.generator:_masks",
        "shaftpose.rendering.generator:SampleGenerator._instrument",
    ],
    "JPEG and tar": ["shaftpose.core.shard_writer:ShardWriter.write"],
}
_MORE = 8  # times the samples, to separate path tracing from Blender's other work


@dataclass(frozen=True)
class Task:
    """Work of one process under the profiler."""

    rendered: RenderedSet
    images: int


def measure(rendered: RenderedSet, images: int) -> dict[str, Any]:
    """Milliseconds of one image by step, the mean over `images` after the first, on one core.

    Blender does not report the time of path tracing. It is the extra time of a set with more
    samples, scaled to the set's own number of samples.
    """
    more = with_samples(rendered, _MORE * SAMPLES)
    own, longer = in_processes(_profile, [Task(rendered, images), Task(more, images)], at_once=1)
    tracing = (longer["rendering"] - own["rendering"]) / (_MORE - 1)
    rendering = own.pop("rendering")
    own["path tracing"] = tracing
    own["Blender's preparation"] = rendering - tracing - own["reading passes"]
    total = own.pop("total")
    own["the rest"] = total - sum(own.values())
    return {"milliseconds": own, "total_milliseconds": total, "images": images}


def _profile(task: Task) -> dict[str, float]:
    """Milliseconds per image of each step and in total."""
    rendered = task.rendered
    with TemporaryDirectory(dir=SCRATCH) as folder, quiet_generator(rendered) as generator:
        shard = Path(folder) / shard_name(0)
        with ShardWriter(shard, rendered.settings.jpeg_quality) as writer:
            writer.write(generator.sample(0))
            profile, start = Profile(), perf_counter()
            with profile:
                for index in range(1, task.images + 1):
                    writer.write(generator.sample(index))
            seconds = perf_counter() - start
    spent = {step: _seconds(profile, *names) for step, names in STEPS.items()}
    spent["total"] = seconds
    return {step: 1000 * value / task.images for step, value in spent.items()}


def _seconds(profile: Profile, *names: str) -> float:
    """Seconds in functions and everything they call."""
    known = Stats(profile).stats  # type: ignore[attr-defined]
    return sum(known[key][3] for key in map(_key, names) if key in known)


def _key(name: str) -> tuple[str, int, str]:
    """The profiler's key of a function `module:name`."""
    module, _, path = name.partition(":")
    code = attrgetter(path)(import_module(module)).__code__
    return code.co_filename, code.co_firstlineno, code.co_name
