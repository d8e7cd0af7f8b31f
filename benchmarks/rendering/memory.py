"""Resident memory of one worker process over many images.

Only the rendering process is measured. The Dask worker that starts it is not counted; it holds no
image.
"""

import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from benchmarks.rendering.common import SCRATCH
from shaftpose.core.errors import InputError
from shaftpose.core.shard_writer import shard_name
from shaftpose.farm.blender_process import IMAGE_DONE
from shaftpose.farm.set_folder import write_set
from shaftpose.rendering.rendered_set import RenderedSet, Shard

EVERY = 50  # images between two measurements


def measure(rendered: RenderedSet, images: int, settled: int) -> dict[str, Any]:
    """Relative growth after the first `settled` images, and the overall peak in MiB."""
    with TemporaryDirectory(dir=SCRATCH) as name:
        shard = Shard(Path(name) / shard_name(0), 0, images)
        write_set(replace(rendered, images=images, images_per_shard=images), Path(name))
        looks = list(_looks(shard))
        if not shard.is_finished():
            log = shard.log.read_text()[-2000:]
            raise InputError(f"the worker did not finish its shard; its log ends with: {log}")
    resident = [look["VmRSS"] for look in looks]
    return {
        "rss_growth": resident[-1] / resident[settled // EVERY - 1] - 1,
        "rss_mib": looks[-1]["VmHWM"],
        "images": images,
        "settled": settled,
        "every": EVERY,
        "mib": resident,
    }


def _looks(shard: Shard) -> Iterator[dict[str, float]]:
    """The memory of a worker after every `EVERY` images of its shard."""
    arguments = [str(value) for value in (shard.path, shard.first, shard.count)]
    command = [sys.executable, "-m", "shaftpose.farm.blender_process", *arguments]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as process:
        images = 0
        assert process.stdout
        for line in process.stdout:
            images += line.strip() == IMAGE_DONE
            if images and images % EVERY == 0:
                yield memory_mib(process.pid)


def memory_mib(pid: int) -> dict[str, float]:
    """Current (`VmRSS`) and peak (`VmHWM`) memory of a process in MiB, from Linux."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    sizes = (line.split() for line in lines if line.startswith(("VmRSS:", "VmHWM:")))
    return {name.rstrip(":"): int(kib) / 1024 for name, kib, _ in sizes}
