"""The task of a Dask worker: one shard, rendered by Blender in a monitored subprocess.

A crash, a hang or a memory leak of Blender is confined to the subprocess, which is then started
again. Dask itself retries a task only if its worker died.
"""

import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import CancelledError
from contextlib import suppress
from dataclasses import dataclass
from select import select
from typing import IO

from distributed import get_worker

from shaftpose.core.errors import InputError
from shaftpose.farm.blender_process import COMPLAINT, IMAGE_DONE, WARNING
from shaftpose.farm.set_folder import record_checksum
from shaftpose.rendering.rendered_set import Shard, software

ATTEMPTS = 3  # per shard, if Blender crashes or hangs
_POLL_S = 0.5  # how soon a cancelled task is noticed
_REPORT_S = 2.0  # reports of a thousand workers must not keep the scheduler busy
_EXIT_S = 10.0  # Blender may hang or crash on exit, after its shard is finished

# Receives the number of finished images ("images") or a warning ("trouble").
Report = Callable[[dict[str, str | int]], None]


class BlenderCrash(Exception):
    """Blender crashed or hung: another attempt may succeed."""


@dataclass(frozen=True)
class RunParameters:
    """Parameters shared by all tasks of one run.

    software: see `rendered_set.software`; it must be the same on all machines. topic: of the tasks'
    report events. hang_s: seconds without a finished image after which Blender is killed.
    """

    software: str
    topic: str
    hang_s: float


def render_shard(shard: Shard, run: RunParameters) -> None:
    """Render one shard unless it is finished.

    Raises InputError if this machine has other software, an image cannot be rendered, or Blender
    crashed or hung in all attempts.
    """
    if run.software != software():
        raise InputError(
            f"{socket.gethostname()}: shaftpose, Blender, OpenCV, numpy or trimesh differ from "
            "those on the machine that started the run; install the same versions"
        )
    # Dask repeats a task whose result was lost with a worker: its shard may be finished.
    if shard.is_finished():
        return
    worker = get_worker()
    key = worker.get_current_task()

    def is_wanted() -> bool:
        task = worker.state.tasks.get(key)
        return task is not None and task.state != "cancelled"

    def report(event: dict[str, str | int]) -> None:
        worker.log_event(run.topic, {"shard": shard.path.name, **event})

    run_with_retries(_command(shard), shard, run.hang_s, is_wanted, report)
    record_checksum(shard.path)


def _command(shard: Shard) -> list[str]:
    arguments = (shard.path, shard.first, shard.count)
    return [sys.executable, "-m", "shaftpose.farm.blender_process", *map(str, arguments)]


def run_with_retries(
    command: list[str], shard: Shard, hang_s: float, is_wanted: Callable[[], bool], report: Report
) -> None:
    """Render a shard in a subprocess; start it again if Blender crashes or hangs.

    is_wanted: once it returns False, the process is killed and CancelledError raised. Raises
    InputError if an image cannot be rendered, or if all attempts crashed or hung.
    """
    for left in reversed(range(ATTEMPTS)):
        try:
            _run(command, shard, hang_s, is_wanted, report)
            return
        except BlenderCrash as crash:
            if not left:
                raise InputError(str(crash)) from crash
            report({"trouble": str(crash)})


def _run(
    command: list[str], shard: Shard, hang_s: float, is_wanted: Callable[[], bool], report: Report
) -> None:
    """Run a rendering process once, to its end."""
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, bufsize=0) as process:
        try:
            assert process.stdout
            complaint = _follow(process.stdout, hang_s, is_wanted, report)
            with suppress(subprocess.TimeoutExpired):
                process.wait(_EXIT_S)
        except TimeoutError as error:
            if shard.is_finished():
                return
            raise BlenderCrash(
                f"{shard.path.name}: Blender finished no image for {hang_s:g} s and was killed; "
                f"see {shard.log}; set cluster.hang_s in params.yaml above the slowest image"
            ) from error
        finally:
            process.kill()
    if not shard.is_finished():
        raise _failure(process.returncode, shard, complaint)


def _follow(output: IO[bytes], hang_s: float, is_wanted: Callable[[], bool], report: Report) -> str:
    """Read a process's output until it ends; return its error message, if any.

    Raises TimeoutError if the process hangs.
    """
    images, complaint = 0, ""
    heard = reported = time.monotonic()
    while is_wanted():
        now = time.monotonic()
        if not select([output], [], [], _POLL_S)[0]:
            if now - heard > hang_s:
                raise TimeoutError
            continue
        said = output.readline()
        if not said:
            return complaint
        heard, line = now, said.decode().strip()
        if line == IMAGE_DONE:
            images += 1
        elif line.startswith(COMPLAINT):
            complaint = line.removeprefix(COMPLAINT)
        elif line.startswith(WARNING):
            report({"trouble": line.removeprefix(WARNING)})
        if now - reported > _REPORT_S:
            report({"images": images})
            reported = now
    raise CancelledError


def _failure(status: int, shard: Shard, complaint: str) -> Exception:
    """The error of a process that ended without finishing its shard."""
    if complaint:  # known even if Blender then crashed, or hung and was killed
        return InputError(complaint)
    if status < 0:
        return BlenderCrash(
            f"{shard.path.name}: Blender was ended by {signal.Signals(-status).name} (SIGKILL: "
            f"often out of memory); see {shard.log}"
        )
    return InputError(f"rendering {shard.path.name} failed; see {shard.log}")
