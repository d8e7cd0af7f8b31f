"""Monitoring of a shard's subprocess, with small programs instead of Blender."""

import sys
import time
from collections.abc import Callable
from concurrent.futures import CancelledError
from pathlib import Path
from typing import Any

import pytest

from shaftpose.core.errors import InputError
from shaftpose.farm import shard_task
from shaftpose.farm.shard_task import (
    ATTEMPTS,
    Report,
    RunParameters,
    render_shard,
    run_with_retries,
)
from shaftpose.rendering.rendered_set import Shard

FOREVER_S = 600.0
# Ends a program after its shard is written: no more output, but the process stays.
CLOSE_AND_STAY = "sys.stdout.flush(); os.close(1); time.sleep(600)"

Watch = Callable[..., None]


@pytest.fixture
def shard(tmp_path: Path) -> Shard:
    return Shard(tmp_path / "shard-000007.tar", 14, 2)


@pytest.fixture
def watch(shard: Shard) -> Watch:
    """Runs a Python program as a monitored subprocess."""

    def run(program: str, hang_s: float = FOREVER_S, **options: Any) -> None:
        command = [sys.executable, "-c", f"import os, signal, sys, time\n{program}"]
        wanted: Callable[[], bool] = options.get("is_wanted", lambda: True)
        report: Report = options.get("report", lambda event: None)
        run_with_retries(command, shard, hang_s, wanted, report)

    return run


def write(shard: Shard, images: int) -> str:
    """A program that writes `images` black images of a shard."""
    return f"""
import numpy as np
from pathlib import Path
from shaftpose.core.geometry import Camera
from shaftpose.core.samples import Sample, sample_key
from shaftpose.core.shard_writer import ShardWriter
with ShardWriter(Path({str(shard.path)!r}), 95) as writer:
    for index in range({shard.first}, {shard.first + images}):
        rgb = np.zeros((8, 8, 3), dtype=np.uint8)
        camera = Camera.from_field_of_view(8, 8, 95.0)
        writer.write(Sample(sample_key(index), rgb, (), camera, {{}}))
"""


def write_all(shard: Shard) -> str:
    """A program that writes a shard."""
    return write(shard, shard.count)


def started(program: str, shard: Shard) -> str:
    """The program, which first leaves a file for each start."""
    count = f"import uuid; open({str(shard.path.parent)!r} + f'/start-{{uuid.uuid4()}}', 'w')"
    return f"{count}\n{program}"


def starts(shard: Shard) -> int:
    return len(list(shard.path.parent.glob("start-*")))


def test_a_shard_that_is_there_is_no_failure(watch: Watch, shard: Shard) -> None:
    watch(started(write_all(shard), shard))
    assert starts(shard) == 1


@pytest.mark.parametrize("end", ["os.kill(os.getpid(), signal.SIGSEGV)", "sys.exit(3)"])
def test_a_crash_after_the_shard_is_finished_does_not_matter(
    watch: Watch, shard: Shard, end: str
) -> None:
    watch(write_all(shard) + end)


def test_a_hang_after_the_shard_is_finished_does_not_matter(
    watch: Watch, shard: Shard, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shard_task, "_EXIT_S", 0.1)
    watch(write_all(shard) + CLOSE_AND_STAY)


def test_a_hang_with_open_output_does_not_matter_once_the_shard_is_finished(
    watch: Watch, shard: Shard
) -> None:
    watch(write_all(shard) + "time.sleep(600)", hang_s=0.2)


def test_a_complaint_is_handed_on_without_another_attempt(watch: Watch, shard: Shard) -> None:
    with pytest.raises(InputError, match=r"^a\.jpg: not a picture$"):
        watch(started("print('error: a.jpg: not a picture'); sys.exit(1)", shard))
    assert starts(shard) == 1


def test_a_shard_without_all_of_its_images_is_a_failure(watch: Watch, shard: Shard) -> None:
    """A power loss may leave such a shard, with zeros in place of the rest."""
    with pytest.raises(InputError, match=f"^rendering {shard.path.name} failed; see {shard.log}$"):
        watch(write(shard, shard.count - 1))


@pytest.mark.parametrize("end", ["os.kill(os.getpid(), signal.SIGSEGV)", CLOSE_AND_STAY])
def test_a_complaint_outlives_a_bad_exit(
    watch: Watch, monkeypatch: pytest.MonkeyPatch, end: str
) -> None:
    monkeypatch.setattr(shard_task, "_EXIT_S", 0.1)
    with pytest.raises(InputError, match=r"^a\.jpg: not a picture$"):
        watch(f"print('error: a.jpg: not a picture', flush=True); {end}")


def test_whoever_fails_without_a_word_left_a_log(watch: Watch, shard: Shard) -> None:
    with pytest.raises(InputError, match=f"^rendering shard-000007.tar failed; see {shard.log}$"):
        watch(started("sys.exit(1)", shard))
    assert starts(shard) == 1


def test_a_process_that_is_always_killed_is_given_up(watch: Watch, shard: Shard) -> None:
    events: list[dict[str, str]] = []
    program = started("os.kill(os.getpid(), signal.SIGKILL)", shard)
    with pytest.raises(InputError, match=r"shard-000007\.tar: .* SIGKILL") as caught:
        watch(program, report=events.append)
    assert str(shard.log) in str(caught.value)
    assert starts(shard) == ATTEMPTS
    assert events == [{"trouble": str(caught.value)}] * (ATTEMPTS - 1)


def test_a_process_that_was_killed_is_started_again(watch: Watch, shard: Shard) -> None:
    killed = shard.path.parent / "killed"
    kill_first = f"""
if not os.path.exists({str(killed)!r}):
    open({str(killed)!r}, "w")
    os.kill(os.getpid(), signal.SIGKILL)
"""
    watch(started(kill_first + write_all(shard), shard))
    assert starts(shard) == 2


def test_a_process_that_hangs_is_killed_and_started_again(watch: Watch, shard: Shard) -> None:
    events: list[dict[str, str]] = []
    start = time.monotonic()
    with pytest.raises(InputError, match=r"shard-000007\.tar: .* no image for 0\.2 s") as caught:
        watch("time.sleep(600)", hang_s=0.2, report=events.append)
    assert len(events) == ATTEMPTS - 1
    assert time.monotonic() - start < FOREVER_S / 2
    assert str(shard.log) in str(caught.value)
    assert "cluster.hang_s" in str(caught.value)


def test_a_process_that_nobody_wants_is_killed(watch: Watch) -> None:
    answers = iter([True, True, False])
    start = time.monotonic()
    with pytest.raises(CancelledError):
        watch("print('image', flush=True); time.sleep(600)", is_wanted=lambda: next(answers))
    assert time.monotonic() - start < FOREVER_S / 2


def test_images_are_reported(watch: Watch, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shard_task, "_REPORT_S", 0.0)
    events: list[dict[str, int]] = []
    with pytest.raises(InputError, match="failed; see"):  # it wrote none
        watch("print('image\\nimage\\nimage')", report=events.append)
    assert events == [{"images": 1}, {"images": 2}, {"images": 3}]


def test_a_warning_is_reported_at_once(watch: Watch) -> None:
    events: list[dict[str, str]] = []
    with pytest.raises(InputError, match="failed; see"):  # it wrote none
        watch("print('warning: no GPU here'); print('image')", report=events.append)
    assert events == [{"trouble": "no GPU here"}]


def test_other_software_than_that_of_the_run_is_refused(shard: Shard) -> None:
    with pytest.raises(InputError, match="install the same versions"):
        render_shard(shard, RunParameters("of another machine", "", 1.0))
