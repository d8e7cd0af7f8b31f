"""Renders one shard in a process of its own: `python -m shaftpose.rendering.worker JOB.json LOG`.

A process has one Blender scene, so a shard is a process. It reports each finished image by a line
on its standard output; Blender's own chatter goes to the end of the log file.
"""

import os
import sys
from pathlib import Path
from typing import TextIO

from pydantic.dataclasses import dataclass

from shaftpose.config import RenderSettings, from_json
from shaftpose.errors import InputError
from shaftpose.shards import ShardWriter

IMAGE_DONE = "image"


@dataclass(frozen=True)
class Job:
    """One shard: images `first` .. `first + count - 1` of a set, to be written to `path`."""

    settings: RenderSettings
    backgrounds: dict[Path, str]
    seed: int
    first: int
    count: int
    path: Path


def main() -> None:
    """Render the job whose file is the first argument; the second is the log file."""
    job_file, log = Path(sys.argv[1]), Path(sys.argv[2])
    progress = _divert_output(log)
    try:
        render_shard(from_json(Job, job_file), progress)
    except InputError as error:
        print(f"error: {error}", file=progress, flush=True)
        sys.exit(1)


def render_shard(job: Job, progress: TextIO) -> None:
    """Write all images of a job; a line to `progress` after each."""
    # Blender is imported only here: whoever describes jobs need not load it.
    from shaftpose.rendering.generator import Generator

    generator = Generator(job.settings, job.backgrounds, job.seed)
    with ShardWriter(job.path, job.settings.jpeg_quality) as shard:
        for index in range(job.first, job.first + job.count):
            shard.write(generator.sample(index))
            print(IMAGE_DONE, file=progress, flush=True)


def _divert_output(log: Path) -> TextIO:
    """Append this process's output to `log`; returns a stream to what was standard output."""
    original = os.fdopen(os.dup(1), "w")
    descriptor = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    os.dup2(descriptor, 1)
    os.dup2(descriptor, 2)
    return original


if __name__ == "__main__":
    main()
