"""Renders one shard: `python -m shaftpose.farm.blender_process SHARD FIRST COUNT`.

SHARD is the shard's file, next to the description of its set; FIRST is the index of its first
image. Blender holds one scene per process, so each shard gets its own process. It prints a line for
each finished image, each warning and an error; Blender's output is appended to the shard's log. It
ends when its standard input closes, so it does not outlive a killed parent.
"""

import logging
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from shaftpose.core.errors import InputError
from shaftpose.core.files import naming_full_disk
from shaftpose.core.shard_writer import ShardWriter
from shaftpose.farm.set_folder import read_set
from shaftpose.rendering import cad
from shaftpose.rendering.rendered_set import RenderedSet, Shard

if TYPE_CHECKING:
    from shaftpose.rendering.generator import SampleGenerator

IMAGE_DONE = "image"
COMPLAINT = "error: "
WARNING = "warning: "


def main() -> None:
    """Render the shard that the command line describes."""
    path, first, count = sys.argv[1:]
    shard = Shard(Path(path), int(first), int(count))
    threading.Thread(target=_end_with_input, daemon=True).start()
    progress = os.fdopen(os.dup(1), "w")
    logging.basicConfig(stream=progress, level=logging.WARNING, format=f"{WARNING}%(message)s")
    cad.logger.disabled = True  # the parent has already logged these warnings
    try:
        with naming_full_disk(shard.path.parent):
            _send_output_to(shard.log)
            write_images(read_set(shard.path.parent), shard, progress)
    except InputError as error:
        print(f"{COMPLAINT}{error}", file=progress)
        sys.exit(1)
    finally:
        progress.close()  # signals the end to the parent, even if Blender hangs on exit


def write_images(rendered: RenderedSet, shard: Shard, progress: TextIO) -> None:
    """Write all images of a shard; print a line to `progress` after each."""
    generator = start_generator(rendered)
    with ShardWriter(shard.path, rendered.settings.jpeg_quality) as writer:
        for index in range(shard.first, shard.first + shard.count):
            writer.write(generator.sample(index))
            print(IMAGE_DONE, file=progress, flush=True)


def start_generator(rendered: RenderedSet) -> "SampleGenerator":
    """The image generator of a set, for a process that shares the machine with others.

    Blender starts a thread for each core that the process may use. These wait in a busy loop and
    would slow other workers down by half, so Blender is loaded while only one core is allowed.
    It is imported only here: the process that starts this one need not load it.
    """
    with _on_one_core():
        from shaftpose.rendering.generator import SampleGenerator
    return SampleGenerator(rendered.settings, rendered.backgrounds, rendered.seed)


@contextmanager
def _on_one_core() -> Iterator[None]:
    """Restrict this process to one core, where the system supports it (Linux)."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(allowed)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, allowed)


def _end_with_input() -> None:
    # Not sys.stdin: at exit, Python would wait for the lock held by a blocked read.
    while os.read(0, 1):
        pass
    os._exit(1)


def _send_output_to(log: Path) -> None:
    """Append this process's standard output and error to `log`."""
    descriptor = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    os.dup2(descriptor, 1)
    os.dup2(descriptor, 2)


if __name__ == "__main__":
    main()
