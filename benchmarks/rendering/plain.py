"""Comparison with a plain script that renders the same scenes on the same cores."""

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from statistics import mean
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

from benchmarks.rendering.common import ROOT, SCRATCH, in_processes, quiet_generator
from benchmarks.rendering.scenes import write_first_scenes
from shaftpose.core.samples import encode_sample
from shaftpose.farm.set_folder import write_set
from shaftpose.rendering.rendered_set import RenderedSet

_PROCESSES = 2


@dataclass(frozen=True)
class Task:
    """Work of one of our processes: the first `poses` images of a set, `rounds` times."""

    rendered: RenderedSet
    poses: int
    rounds: int


def measure(rendered: RenderedSet, poses: int, rounds: int) -> dict[str, Any]:
    """Seconds per image of both, without start-up: one plain process on all cores, and two of ours
    on one core each, up to the encoded image and annotations."""
    ours = [Task(rendered, poses, rounds)] * _PROCESSES
    ours_s = mean(in_processes(_seconds, ours, at_once=_PROCESSES)) / _PROCESSES
    plain_s = mean(_plain_seconds(rendered, poses))
    return {
        "speedup_vs_plain": plain_s / ours_s,
        "plain_s": plain_s,
        "ours_s": ours_s,
        "poses": poses,
        "rounds": rounds,
    }


def _seconds(task: Task) -> float:
    """Seconds per image of one process."""
    rendered = task.rendered
    with quiet_generator(rendered) as generator:
        generator.sample(task.poses)  # the first render fills caches
        start = perf_counter()
        for _ in range(task.rounds):
            for index in range(task.poses):
                encode_sample(generator.sample(index), rendered.settings.jpeg_quality)
        return (perf_counter() - start) / (task.rounds * task.poses)


def _plain_seconds(rendered: RenderedSet, poses: int) -> list[float]:
    """Seconds of each image of the plain script."""
    with TemporaryDirectory(dir=SCRATCH) as name:
        folder = Path(name)
        write_set(rendered, folder)
        write_first_scenes(rendered, poses, folder)
        command = [sys.executable, "-m", "benchmarks.rendering.plain_bpy", name]
        with (folder / "log").open("w") as log:
            subprocess.run(command, cwd=ROOT, stdout=log, stderr=subprocess.STDOUT, check=True)
        seconds: list[float] = json.loads((folder / "plain.json").read_text())
    return seconds
