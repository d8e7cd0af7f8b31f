"""Whole sets rendered by Dask workers: the same bytes after any kind of failure."""

import json
import logging
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import psutil
import pytest
from distributed import Client, LocalCluster

from shaftpose.core.errors import InputError
from shaftpose.core.samples import sample_key
from shaftpose.core.shards import ShardedDataset
from shaftpose.farm import render_sets
from shaftpose.farm import workers as dask_workers
from shaftpose.farm.cluster import cluster_client
from shaftpose.farm.render_sets import render_set
from shaftpose.farm.shard_task import ATTEMPTS
from shaftpose.rendering.rendered_set import RenderedSet, Shard
from shaftpose.rendering.scene_sampler import SceneSampler
from shaftpose.settings.schema import ClusterSettings, RenderSettings
from tests.rendering.blender_process import start_python

IMAGES, PER_SHARD, SHARDS = 8, 4, 2
PATIENCE_S = 600.0  # enough for a busy machine

RENDER_SET = """
import signal
import sys
from shaftpose.settings.schema import ClusterSettings
from shaftpose.farm.cluster import cluster_client
from shaftpose.rendering.rendered_set import RenderedSet
from shaftpose.farm.render_sets import render_set
if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's `&` takes it away
    sources = {Path(path): source for path, source in backgrounds}
    rendered = RenderedSet(settings, sources, seed, images, per_shard)
    cluster = ClusterSettings(workers=1, address=address, slurm=None, hang_s=600.0)
    try:
        with cluster_client(cluster) as client:
            render_set(rendered, Path("scratch"), Path("out"), client, cluster.hang_s)
    except KeyboardInterrupt:
        sys.exit("interrupted")
"""


@contextmanager
def workers(count: int, address: str | None = None) -> Iterator[Client]:
    settings = ClusterSettings(workers=count, address=address, slurm=None, hang_s=1.0)
    with cluster_client(settings) as client:
        yield client


@pytest.fixture(scope="module")
def client() -> Iterator[Client]:
    """Two workers."""
    with workers(2) as client:
        yield client


@pytest.fixture
def mortal_client() -> Iterator[Client]:
    """Two workers for a test that kills some, not all of which Dask may replace."""
    with workers(2) as client:
        yield client


@pytest.fixture(scope="module")
def lone_client() -> Iterator[Client]:
    """One worker, which renders the shards in order."""
    with workers(1) as client:
        yield client


@pytest.fixture(scope="module")
def running_scheduler() -> Iterator[str]:
    """The address of a scheduler with one worker, as a user has started it, without keys."""
    with LocalCluster(
        n_workers=1, threads_per_worker=1, host="127.0.0.1", dashboard_address=None
    ) as cluster:
        yield cluster.scheduler_address


@pytest.fixture(scope="module")
def rendered(settings: RenderSettings, backgrounds: Mapping[Path, str]) -> RenderedSet:
    return RenderedSet(replace(settings, samples=(2, 2)), backgrounds, 17, IMAGES, PER_SHARD)


def render(rendered: RenderedSet, folder: Path, client: Client, hang_s: float = PATIENCE_S) -> None:
    """Render a set into `folder/out` via `folder/scratch`."""
    render_set(rendered, folder / "scratch", folder / "out", client, hang_s)


@pytest.fixture(scope="module")
def undisturbed_run(
    rendered: RenderedSet, client: Client, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, float]:
    """Folder of an undisturbed run, and its duration in seconds."""
    folder = tmp_path_factory.mktemp("undisturbed")
    begin = time.monotonic()
    render(rendered, folder, client)
    return folder, time.monotonic() - begin


@pytest.fixture(scope="module")
def undisturbed(undisturbed_run: tuple[Path, float]) -> tuple[Path, Path]:
    """Scratch and output folder of an undisturbed run."""
    folder, _ = undisturbed_run
    return folder / "scratch", folder / "out"


@pytest.fixture(scope="module")
def hang_s(undisturbed_run: tuple[Path, float]) -> float:
    """Longer than Blender needs on this machine to start and render an image."""
    _, seconds = undisturbed_run
    return max(10.0, 3 * seconds)


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def identity(path: Path) -> tuple[int, int]:
    """Inode and time of change, which differ after a file is rewritten."""
    status = path.stat()
    return status.st_ino, status.st_mtime_ns


def wait_until(condition: Callable[[], Any]) -> Any:
    """Wait for a condition and return its value."""
    end = time.monotonic() + PATIENCE_S
    while not (value := condition()):
        assert time.monotonic() < end, "it never came about"
        time.sleep(0.005)
    return value


def blenders(folder: Path, shard: str = "") -> list[psutil.Process]:
    """The processes that render a shard below `folder`."""
    prefix = str(folder / "scratch")
    return [
        process
        for process in psutil.process_iter(["cmdline"])
        if any(a.startswith(prefix) and shard in a for a in process.info["cmdline"] or ())
    ]


def stopped_in_the_middle(folder: Path) -> psutil.Process:
    """The first process with a partly written shard below `folder`, suspended."""

    def stopped() -> psutil.Process | None:
        for part in folder.rglob("*.part"):
            with suppress(psutil.NoSuchProcess):  # it has just ended
                process = psutil.Process(int(part.name.split(".")[-2]))
                process.suspend()
                if part.exists():
                    return process
                process.resume()  # it has just finished its shard
        return None

    process = wait_until(stopped)
    assert isinstance(process, psutil.Process)
    return process


def has_ended(process: psutil.Process) -> bool:
    try:
        return not process.is_running() or process.status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:  # ended between the two calls
        return True


@pytest.fixture
def background() -> Iterator[Callable[..., Future[None]]]:
    """Starts a run in a thread, for a test to disturb it."""
    with ThreadPoolExecutor() as pool:
        yield lambda *arguments: pool.submit(render, *arguments)


def test_a_set_holds_all_its_images(rendered: RenderedSet, undisturbed: tuple[Path, Path]) -> None:
    _, out = undisturbed
    assert sorted(contents(out)) == [f"shard-{n:06d}.tar" for n in range(SHARDS)]
    dataset = ShardedDataset(out)
    assert dataset.keys == [sample_key(index) for index in range(IMAGES)]
    for index, key in enumerate(dataset.keys):
        described = dataset.scene_description(key)
        assert described["index"] == index
        assert described["seed"] == rendered.seed
        assert described["source"] in rendered.backgrounds.values()
        assert len(dataset.masks(key)) == len(described["shafts"]) >= 1


def test_finished_shards_are_linked_not_copied(
    rendered: RenderedSet, undisturbed: tuple[Path, Path]
) -> None:
    scratch, out = undisturbed
    for shard in rendered.shards(scratch / rendered.fingerprint()):
        assert shard.path.samefile(out / shard.path.name)


def test_the_images_depend_neither_on_the_workers_nor_on_who_started_them(
    rendered: RenderedSet, undisturbed: tuple[Path, Path], running_scheduler: str, tmp_path: Path
) -> None:
    with workers(99, address=running_scheduler) as client:
        assert len(client.nthreads()) == 1
        render(rendered, tmp_path, client)
    assert contents(tmp_path / "out") == contents(undisturbed[1])


def test_a_finished_set_is_not_rendered_again(
    rendered: RenderedSet, undisturbed: tuple[Path, Path], client: Client, tmp_path: Path
) -> None:
    scratch, out = undisturbed
    before = {path: identity(path) for path in sorted(scratch.rglob("*.tar"))}
    assert len(before) == SHARDS
    render_set(rendered, scratch, tmp_path / "out", client, PATIENCE_S)
    assert {path: identity(path) for path in sorted(scratch.rglob("*.tar"))} == before
    assert contents(tmp_path / "out") == contents(out)


# Blender dies, hangs or leaks.


def test_a_killed_blender_is_started_again(
    rendered: RenderedSet,
    undisturbed: tuple[Path, Path],
    client: Client,
    background: Callable[..., Future[None]],
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:
    run = background(rendered, tmp_path, client)
    stopped_in_the_middle(tmp_path).kill()
    run.result(PATIENCE_S)
    assert contents(tmp_path / "out") == contents(undisturbed[1])
    assert not list(tmp_path.rglob("*.part"))
    (warning,) = [r.getMessage() for r in caplog.records if r.name == render_sets.__name__
                  and r.levelno == logging.WARNING]  # fmt: skip
    assert "SIGKILL" in warning


def test_a_hung_blender_is_killed_and_its_shard_rendered_by_another(
    rendered: RenderedSet,
    undisturbed: tuple[Path, Path],
    client: Client,
    background: Callable[..., Future[None]],
    hang_s: float,
    tmp_path: Path,
) -> None:
    run = background(rendered, tmp_path, client, hang_s)
    hung = stopped_in_the_middle(tmp_path)
    run.result(PATIENCE_S)
    assert has_ended(hung)
    assert contents(tmp_path / "out") == contents(undisturbed[1])


def test_a_blender_that_always_dies_ends_the_run(
    rendered: RenderedSet,
    client: Client,
    background: Callable[..., Future[None]],
    tmp_path: Path,
) -> None:
    run = background(replace(rendered, images=PER_SHARD), tmp_path, client)
    killed = set[psutil.Process]()
    while not run.done():
        new = set(blenders(tmp_path)) - killed
        for process in new:
            process.kill()
        killed |= new
        time.sleep(0.01)
    with pytest.raises(InputError, match=r"shard-000000\.tar: .* SIGKILL") as caught:
        run.result()
    assert "shard-000000.log" in str(caught.value)
    assert len(killed) == ATTEMPTS


# A Dask worker dies.


def test_a_killed_dask_worker_is_replaced_and_takes_its_blender_along(
    rendered: RenderedSet,
    undisturbed: tuple[Path, Path],
    mortal_client: Client,
    background: Callable[..., Future[None]],
    tmp_path: Path,
) -> None:
    run = background(rendered, tmp_path, mortal_client)
    orphan = stopped_in_the_middle(tmp_path)
    orphan.parent().kill()
    orphan.resume()
    wait_until(lambda: has_ended(orphan))
    run.result(PATIENCE_S)
    assert contents(tmp_path / "out") == contents(undisturbed[1])


def test_a_shard_whose_dask_workers_all_die_ends_the_run(
    rendered: RenderedSet,
    mortal_client: Client,
    background: Callable[..., Future[None]],
    tmp_path: Path,
) -> None:
    run = background(replace(rendered, images=PER_SHARD), tmp_path, mortal_client)
    killed = set[psutil.Process]()
    while not run.done():
        # A Blender process whose worker has died is adopted by a process outside of this test.
        ours = set(psutil.Process().children(recursive=True))
        with suppress(psutil.NoSuchProcess):  # it has just ended, too
            for worker in {blender.parent() for blender in blenders(tmp_path)} & (ours - killed):
                worker.kill()
                killed.add(worker)
        time.sleep(0.01)
    with pytest.raises(InputError, match=r"shard-000000\.tar: every Dask worker that"):
        run.result()
    assert len(killed) == 4


def test_what_a_dead_worker_left_is_removed(
    rendered: RenderedSet,
    undisturbed: tuple[Path, Path],
    finished: list[Shard],
    client: Client,
    tmp_path: Path,
) -> None:
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    path = finished[0].path
    path.unlink()
    remains = path.with_name(f"{path.name}.{socket.gethostname()}.{dead.pid}.part")
    remains.write_bytes(b"half a shard" * 100_000)
    render(rendered, tmp_path, client)
    assert not list(path.parent.glob("*.part"))
    assert contents(tmp_path / "out") == contents(undisturbed[1])


# A Dask scheduler dies.


@pytest.fixture
def scheduler(tmp_path: Path) -> Iterator[tuple[subprocess.Popen[bytes], str]]:
    """A scheduler with one worker, started from the command line, and its address."""
    file = tmp_path / "scheduler.json"
    dask = [sys.executable, "-m", "dask"]
    here = ["--host", "127.0.0.1", "--dashboard-address", "127.0.0.1:0", "--scheduler-file", file]
    with (
        subprocess.Popen([*dask, "scheduler", "--port", "0", *here]) as scheduler,
        subprocess.Popen([*dask, "worker", "--nthreads", "1", *here]) as worker,
    ):
        wait_until(file.exists)
        yield scheduler, json.loads(wait_until(file.read_text))["address"]
        worker.terminate()
        scheduler.terminate()


def test_a_lost_scheduler_ends_the_run(
    rendered: RenderedSet,
    scheduler: tuple[subprocess.Popen[bytes], str],
    background: Callable[..., Future[None]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(dask_workers, "_ANSWER_S", 5.0)
    process, address = scheduler
    with workers(1, address) as client:
        run = background(rendered, tmp_path, client)
        blender = stopped_in_the_middle(tmp_path)
        process.kill()
        with pytest.raises(InputError, match="connection to the Dask scheduler is lost"):
            run.result(PATIENCE_S)
        blender.kill()
    assert not (tmp_path / "out").exists()


def test_a_scheduler_that_is_lost_before_the_first_shard_ends_the_run(
    rendered: RenderedSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dask_workers, "_ANSWER_S", 1.0)
    with (
        LocalCluster(n_workers=0, host="127.0.0.1", dashboard_address=None) as idle,
        dask_workers.client_of(idle.scheduler_address) as client,
    ):
        client.timeout = 0.1
        idle.close()
        with pytest.raises(InputError, match="scheduler is lost; run again to continue$"):
            render(rendered, tmp_path, client)


# The run itself is interrupted or killed, or started twice.


def start_run(rendered: RenderedSet, folder: Path, address: str | None) -> subprocess.Popen[str]:
    return start_python(
        RENDER_SET,
        folder,
        rendered.settings,
        backgrounds=[(str(path), source) for path, source in rendered.backgrounds.items()],
        seed=rendered.seed,
        images=IMAGES,
        per_shard=PER_SHARD,
        address=address,
    )


def family(process: subprocess.Popen[str]) -> list[psutil.Process]:
    """A process and all its descendants."""
    main = psutil.Process(process.pid)
    return [main, *main.children(recursive=True)]


def test_ctrl_c_ends_all_processes_and_keeps_finished_shards(
    rendered: RenderedSet, undisturbed: tuple[Path, Path], client: Client, tmp_path: Path
) -> None:
    process = start_run(rendered, tmp_path, address=None)
    shards = rendered.shards(tmp_path / "scratch" / rendered.fingerprint())
    wait_until(lambda: shards[0].path.exists() and blenders(tmp_path))
    before, all_processes = identity(shards[0].path), family(process)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does
    output, _ = process.communicate(timeout=PATIENCE_S)
    assert output.strip().endswith("interrupted")
    assert "Traceback" not in output
    wait_until(lambda: all(map(has_ended, all_processes)))
    assert not (tmp_path / "out").exists()

    render(rendered, tmp_path, client)
    assert identity(shards[0].path) == before
    assert contents(tmp_path / "out") == contents(undisturbed[1])


def test_a_killed_run_leaves_no_process_and_continues_to_the_same_bytes(
    rendered: RenderedSet, undisturbed: tuple[Path, Path], client: Client, tmp_path: Path
) -> None:
    process = start_run(rendered, tmp_path, address=None)
    shards = rendered.shards(tmp_path / "scratch" / rendered.fingerprint())
    wait_until(lambda: shards[0].path.exists() and blenders(tmp_path))
    before, all_processes = identity(shards[0].path), family(process)
    process.kill()
    process.communicate(timeout=PATIENCE_S)
    wait_until(lambda: all(map(has_ended, all_processes)))
    assert not shards[-1].path.exists()
    assert not (tmp_path / "out").exists()

    render(rendered, tmp_path, client)
    assert identity(shards[0].path) == before
    assert contents(tmp_path / "out") == contents(undisturbed[1])


def test_workers_of_others_drop_the_shards_of_a_run_that_was_killed(
    rendered: RenderedSet, running_scheduler: str, tmp_path: Path
) -> None:
    process = start_run(rendered, tmp_path, running_scheduler)
    blender = stopped_in_the_middle(tmp_path)
    process.kill()
    process.communicate(timeout=PATIENCE_S)
    wait_until(lambda: has_ended(blender))
    assert not list(tmp_path.rglob("*.tar"))


def test_a_second_run_of_the_same_set_or_into_the_same_folder_does_not_disturb_the_first(
    rendered: RenderedSet,
    undisturbed: tuple[Path, Path],
    client: Client,
    background: Callable[..., Future[None]],
    tmp_path: Path,
) -> None:
    run = background(rendered, tmp_path, client)
    stopped = stopped_in_the_middle(tmp_path)
    scratch, out = tmp_path / "scratch", tmp_path / "out"
    another = replace(rendered, seed=rendered.seed + 1)
    for second, second_out, refused in (
        (rendered, tmp_path / "elsewhere", scratch / rendered.fingerprint()),
        (another, out, out),
    ):
        with pytest.raises(InputError, match="another run is writing to this folder") as caught:
            render_set(second, scratch, second_out, client, PATIENCE_S)
        assert str(caught.value).startswith(f"{refused}: ")
    stopped.resume()
    run.result(PATIENCE_S)
    assert contents(tmp_path / "out") == contents(undisturbed[1])
    render(rendered, tmp_path, client)
    assert contents(tmp_path / "out") == contents(undisturbed[1])


# Files are damaged, or the disk is full.


@pytest.fixture
def finished(rendered: RenderedSet, undisturbed: tuple[Path, Path], tmp_path: Path) -> list[Shard]:
    """A copy of the shards of `undisturbed` in `tmp_path/scratch`."""
    shutil.copytree(undisturbed[0], tmp_path / "scratch")
    return rendered.shards(tmp_path / "scratch" / rendered.fingerprint())


def cut_short(path: Path) -> None:
    """Truncate a file in place, as a full disk or an interrupted copy does."""
    os.truncate(path, path.stat().st_size // 2)


def test_a_truncated_shard_in_scratch_is_rendered_again(
    rendered: RenderedSet,
    undisturbed: tuple[Path, Path],
    finished: list[Shard],
    client: Client,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:
    cut_short(finished[1].path)
    before = identity(finished[0].path)
    with caplog.at_level(logging.WARNING, logger=render_sets.__name__):
        render(rendered, tmp_path, client)
    assert f"{finished[1].path} is truncated or damaged: rendering it again" in caplog.messages
    assert contents(tmp_path / "out") == contents(undisturbed[1])
    assert identity(finished[0].path) == before


def test_a_shard_with_one_flipped_bit_is_rendered_again(
    rendered: RenderedSet,
    undisturbed: tuple[Path, Path],
    finished: list[Shard],
    client: Client,
    tmp_path: Path,
) -> None:
    path = finished[0].path
    data = bytearray(path.read_bytes())
    data[3000] ^= 1  # in the first image
    path.write_bytes(data)
    render(rendered, tmp_path, client)
    assert contents(tmp_path / "out") == contents(undisturbed[1])


def test_a_truncated_shard_in_out_is_mended_by_running_again(
    rendered: RenderedSet,
    undisturbed: tuple[Path, Path],
    finished: list[Shard],
    client: Client,
    tmp_path: Path,
) -> None:
    out, path = tmp_path / "out", finished[0].path
    render(rendered, tmp_path, client)
    cut_short(out / path.name)
    assert path.read_bytes() == (out / path.name).read_bytes()  # one file, two names
    with pytest.raises(InputError, match="dvc repro -s -f render"):
        ShardedDataset(out)
    render(rendered, tmp_path, client)
    assert contents(out) == contents(undisturbed[1])
    assert path.samefile(out / path.name)


@contextmanager
def small_disk(disk: Path, shard_bytes: int) -> Iterator[None]:
    """A new folder as a separate disk with room for one and a half shards."""
    disk.mkdir()
    size = shard_bytes * 3 // 2
    mount = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(disk)]
    done = subprocess.run(mount, capture_output=True, text=True)
    if done.returncode:
        pytest.skip(f"a small disk cannot be mounted here: {done.stderr.strip()}")
    try:
        yield
    finally:
        subprocess.run(["umount", str(disk)], check=True)


def make_room(disk: Path) -> None:
    subprocess.run(["mount", "-o", "remount,size=64m", str(disk)], check=True)


@pytest.fixture(scope="module")
def shard_bytes(undisturbed: tuple[Path, Path]) -> int:
    """The size of the larger shard."""
    return max(map(len, contents(undisturbed[1]).values()))


def test_a_full_disk_ends_the_run_and_room_lets_it_continue(
    rendered: RenderedSet,
    undisturbed: tuple[Path, Path],
    shard_bytes: int,
    lone_client: Client,
    tmp_path: Path,
) -> None:
    disk = tmp_path / "scratch"
    with small_disk(disk, shard_bytes):
        with pytest.raises(InputError, match="No space left on device; make room") as caught:
            render(rendered, tmp_path, lone_client)
        assert str(caught.value).startswith(str(disk))
        first, second = rendered.shards(disk / rendered.fingerprint())
        before = identity(first.path)
        assert not second.path.exists()
        assert not list(disk.rglob("*.part"))
        assert not (tmp_path / "out").exists()

        make_room(disk)
        render(rendered, tmp_path, lone_client)
        assert identity(first.path) == before
        assert contents(tmp_path / "out") == contents(undisturbed[1])


def test_shards_are_copied_whole_to_another_disk_or_not_at_all(
    rendered: RenderedSet,
    undisturbed: tuple[Path, Path],
    shard_bytes: int,
    lone_client: Client,
    tmp_path: Path,
) -> None:
    disk = tmp_path / "disk"
    with small_disk(disk, shard_bytes):
        with pytest.raises(InputError, match="No space left on device; make room") as caught:
            render_set(rendered, undisturbed[0], disk / "out", lone_client, PATIENCE_S)
        assert str(caught.value).startswith(f"{disk / 'out'}: ")
        (name,) = contents(disk / "out")
        assert (disk / "out" / name).read_bytes() == (undisturbed[1] / name).read_bytes()

        make_room(disk)
        render_set(rendered, undisturbed[0], disk / "out", lone_client, PATIENCE_S)
        assert contents(disk / "out") == contents(undisturbed[1])


# A shard cannot be rendered.


def a_good_and_a_bad(backgrounds: Mapping[Path, str], folder: Path) -> tuple[Path, Path]:
    """A background and a file that is not an image."""
    bad = folder / "broken.jpg"
    bad.write_bytes(b"this is no picture")
    return next(iter(backgrounds)), bad


def seed_showing(settings: RenderSettings, first: Path, second: Path) -> int:
    """A seed whose image 0 shows the first background and image 1 the second."""
    paths = sorted((first, second))

    def shown(seed: int) -> list[Path]:
        sampler = SceneSampler(settings, paths, seed)
        return [next(sampler.candidates(index)).background for index in range(2)]

    return next(seed for seed in range(100) if shown(seed) == [first, second])


def one_image_per_shard(settings: RenderSettings, first: Path, second: Path) -> RenderedSet:
    seed = seed_showing(settings, first, second)
    sources = {path: path.name for path in sorted((first, second))}
    return RenderedSet(replace(settings, samples=(1, 1)), sources, seed, 2, 1)


def test_a_failing_shard_names_the_file_and_keeps_finished_shards(
    with_scene: Callable[..., RenderSettings],
    backgrounds: Mapping[Path, str],
    lone_client: Client,
    tmp_path: Path,
) -> None:
    good, bad = a_good_and_a_bad(backgrounds, tmp_path)
    rendered = one_image_per_shard(with_scene(instruments=(1, 1)), good, bad)
    with pytest.raises(InputError, match="damaged; delete it") as caught:
        render(rendered, tmp_path, lone_client)
    assert str(bad) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not str(caught.value).startswith("error")
    first, second = rendered.shards(tmp_path / "scratch" / rendered.fingerprint())
    assert ShardedDataset(first.path.parent).keys == [sample_key(0)]
    assert not second.path.exists()
    assert not list(first.path.parent.glob("*.part"))
    assert not (tmp_path / "out").exists()


def test_a_failing_shard_ends_all_others(
    with_scene: Callable[..., RenderSettings],
    backgrounds: Mapping[Path, str],
    client: Client,
    background: Callable[..., Future[None]],
    tmp_path: Path,
) -> None:
    good, bad = a_good_and_a_bad(backgrounds, tmp_path)
    rendered = one_image_per_shard(with_scene(instruments=(1, 1)), bad, good)
    run = background(rendered, tmp_path, client)
    (other,) = wait_until(lambda: blenders(tmp_path, "shard-000001"))
    other.suspend()  # it would never end by itself
    with pytest.raises(InputError, match="damaged; delete it"):
        run.result(PATIENCE_S)
    wait_until(lambda: has_ended(other))
    assert not (tmp_path / "out").exists()


def test_a_background_that_vanishes_while_the_set_is_rendered_is_named(
    rendered: RenderedSet, client: Client, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(RenderedSet, "fingerprint", lambda self: "constant")
    gone = replace(rendered, backgrounds={tmp_path / "gone.jpg": "s"}, images=1)
    with pytest.raises(InputError, match=r"gone\.jpg: cannot be read"):
        render(gone, tmp_path, client)


def test_a_shard_that_fails_without_a_word_leaves_its_log(
    rendered: RenderedSet, client: Client, tmp_path: Path
) -> None:
    # Not an InputError: numpy rejects the seed.
    with pytest.raises(InputError, match=r"shard-000000\.tar failed; see .*\.log") as caught:
        render(replace(rendered, seed=-1, images=1), tmp_path, client)
    log = Path(str(caught.value).rpartition("see ")[2])
    assert "ValueError" in log.read_text()
