"""The task of a Dask worker: one shard, rendered by Blender in a subprocess under watch.

A crash, a hang or a leak of Blender stays in the subprocess; the Dask worker survives it.
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

from shaftpose.errors import InputError
from shaftpose.rendering.jobs import Shard, software
from shaftpose.rendering.worker import COMPLAINT, IMAGE_DONE, WARNING

_POLL_S = 0.5  # how soon the end of a task that nobody wants any more is noticed
_REPORT_S = 2.0  # a thousand workers that report shall not keep the scheduler busy
_EXIT_S = 10.0  # Blender may hang or crash when it exits, its shard finished


@dataclass(frozen=True)
class Run:
    """What the tasks of one run share.

    software: see `jobs.software`; every machine must have the same. topic: of the events by which
    tasks report. hang_s: Blender is killed after so many seconds without a finished image.
    """

    software: str
    topic: str
    hang_s: float


def render_shard(shard: Shard, run: Run) -> str:
    """Render one shard unless it is finished.

    Returns what is wrong, in one line, if to try again would be in vain, otherwise "". Raises
    InputError if Blender crashed or hung: Dask tries again.
    """
    if run.software != software():
        return (
            f"{socket.gethostname()}: shaftpose, Blender, OpenCV, numpy or trimesh differ from "
            "those where the run was started; install the same versions"
        )
    # Dask repeats a task whose result was lost with a worker: its shard may be there.
    if shard.is_finished():
        return ""
    worker = get_worker()
    key = worker.get_current_task()

    def is_wanted() -> bool:
        task = worker.state.tasks.get(key)
        return task is not None and task.state != "cancelled"

    def report(event: dict[str, str | int]) -> None:
        worker.log_event(run.topic, {"shard": shard.path.name, **event})

    try:
        return run_blender(_command(shard), shard, run.hang_s, is_wanted, report)
    except InputError as error:
        report({"trouble": str(error)})
        raise


def _command(shard: Shard) -> list[str]:
    arguments = (shard.path, shard.first, shard.count)
    return [sys.executable, "-m", "shaftpose.rendering.worker", *map(str, arguments)]


def run_blender(
    command: list[str],
    shard: Shard,
    hang_s: float,
    is_wanted: Callable[[], bool],
    report: Callable[[dict[str, str | int]], None],
) -> str:
    """Run a worker process to its end; returns and raises what `render_shard` does.

    is_wanted: once it says no, the process is killed and CancelledError raised. report: is told how
    many images are finished.
    """
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0)
    with process:
        try:
            assert process.stdout
            complaint = _follow(process.stdout, hang_s, is_wanted, report)
            with suppress(subprocess.TimeoutExpired):
                process.wait(_EXIT_S)
        except TimeoutError as error:
            if not shard.is_finished():
                raise InputError(
                    f"{shard.path.name}: Blender finished no image for {hang_s:g} s and was killed;"
                    f" see {shard.log}; cluster.hang_s in params.yaml must exceed the slowest image"
                ) from error
            complaint = ""
        finally:
            process.kill()
    return "" if shard.is_finished() else _failure(process.returncode, shard, complaint)


def _follow(
    output: IO[bytes],
    hang_s: float,
    is_wanted: Callable[[], bool],
    report: Callable[[dict[str, str | int]], None],
) -> str:
    """Read what a process says until it ends; returns its complaint, if it has one."""
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


def _failure(status: int, shard: Shard, complaint: str) -> str:
    if complaint:  # Blender may crash or hang when it exits, and be ended for that
        return complaint
    if status < 0:
        raise InputError(
            f"{shard.path.name}: Blender was ended by {signal.Signals(-status).name} (SIGKILL: "
            f"often for want of memory); see {shard.log}"
        )
    return f"rendering {shard.path.name} failed; see {shard.log}"
