"""Renders one shard in a process of its own: `python -m shaftpose.rendering.worker SHARD 0 200`.

The numbers are those of its first image and of all; SHARD is its file, and the description of its
set lies beside it. A process has one Blender scene, so a shard is a process. It reports each
finished image and each warning by a line on its standard output; Blender's own chatter goes to the
end of the shard's log. It ends when its standard input does: who started it leaves nobody behind,
even killed.
"""

import logging
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from shaftpose.errors import InputError
from shaftpose.files import naming_full_disk
from shaftpose.rendering import cad
from shaftpose.rendering.jobs import RenderedSet, Shard, read_set
from shaftpose.shards import ShardWriter

if TYPE_CHECKING:
    from shaftpose.rendering.generator import Generator

IMAGE_DONE = "image"
COMPLAINT = "error: "
WARNING = "warning: "


def main() -> None:
    """Render the shard that the arguments describe."""
    path, first, count = sys.argv[1:]
    shard = Shard(Path(path), int(first), int(count))
    threading.Thread(target=_end_with_input, daemon=True).start()
    progress = os.fdopen(os.dup(1), "w")
    logging.basicConfig(stream=progress, level=logging.WARNING, format=f"{WARNING}%(message)s")
    cad.logger.disabled = True  # whoever has started this process has read the file and said it
    try:
        with naming_full_disk(shard.path.parent):
            _send_output_to(shard.log)
            render_shard(read_set(shard.path.parent), shard, progress)
    except InputError as error:
        print(f"{COMPLAINT}{error}", file=progress)
        sys.exit(1)
    finally:
        progress.close()  # whoever listens knows that it is over, even if Blender hangs at its exit


def render_shard(rendered: RenderedSet, shard: Shard, progress: TextIO) -> None:
    """Write all images of a shard; a line to `progress` after each."""
    generator = start_generator(rendered)
    with ShardWriter(shard.path, rendered.settings.jpeg_quality) as writer:
        for index in range(shard.first, shard.first + shard.count):
            writer.write(generator.sample(index))
            print(IMAGE_DONE, file=progress, flush=True)


def start_generator(rendered: RenderedSet) -> "Generator":
    """The generator of a set, for a process that has one core.

    Blender is imported only here: whoever starts workers need not load it. On being loaded it
    starts threads for all cores that the process may use. They spin while they wait, and would
    take half of their time from the workers beside this one.
    """
    with _on_one_core():
        from shaftpose.rendering.generator import Generator
    return Generator(rendered.settings, rendered.backgrounds, rendered.seed)


@contextmanager
def _on_one_core() -> Iterator[None]:
    """Let this process use one core only, where the system can be told so (Linux)."""
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
    # Not sys.stdin: Python's exit would wait for a lock that a blocked read of it holds.
    while os.read(0, 1):
        pass
    os._exit(1)


def _send_output_to(log: Path) -> None:
    """Append this process's standard output and errors to `log`."""
    descriptor = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    os.dup2(descriptor, 1)
    os.dup2(descriptor, 2)


if __name__ == "__main__":
    main()
