"""Whole sets rendered by worker processes: the same bytes whatever happens on the way."""

import logging
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import trimesh
from blender_process import start_python

from shaftpose.config import CadSettings, RenderSettings
from shaftpose.errors import InputError
from shaftpose.rendering import jobs, scale_out
from shaftpose.rendering.jobs import RenderedSet, Shard, link_shards
from shaftpose.rendering.scale_out import render_set
from shaftpose.rendering.scene import SceneSampler
from shaftpose.rendering.shapes import instrument_shape
from shaftpose.shards import ShardedDataset, sample_key

IMAGES, PER_SHARD, SHARDS = 6, 2, 3

RENDER_SET = """
from shaftpose.rendering.jobs import RenderedSet
from shaftpose.rendering.scale_out import render_set
sources = {Path(path): source for path, source in backgrounds}
rendered = RenderedSet(settings, sources, seed, images, per_shard)
render_set(rendered, Path("scratch"), Path("out"), workers=1)
"""


@pytest.fixture(scope="module")
def rendered(settings: RenderSettings, backgrounds: Mapping[Path, str]) -> RenderedSet:
    return RenderedSet(replace(settings, samples=1), backgrounds, 17, IMAGES, PER_SHARD)


@pytest.fixture(scope="module")
def undisturbed(
    rendered: RenderedSet, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, Path]:
    """Scratch and output folder of a run with two workers."""
    folder = tmp_path_factory.mktemp("undisturbed")
    render_set(rendered, folder / "scratch", folder / "out", workers=2)
    return folder / "scratch", folder / "out"


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def identity(path: Path) -> tuple[int, int]:
    """What changes if a file is written again."""
    status = path.stat()
    return status.st_ino, status.st_mtime_ns


def test_a_set_holds_all_its_images(rendered: RenderedSet, undisturbed: tuple[Path, Path]) -> None:
    _, out = undisturbed
    assert sorted(contents(out)) == [f"shard-{n:06d}.tar" for n in range(SHARDS)]
    dataset = ShardedDataset(out)
    assert dataset.keys == [sample_key(index) for index in range(IMAGES)]
    for index, key in enumerate(dataset.keys):
        facts = dataset.facts(key)
        assert facts["index"] == index
        assert facts["seed"] == rendered.seed
        assert facts["source"] in rendered.backgrounds.values()
        assert len(dataset.masks(key)) == len(facts["shafts"]) >= 1


def test_finished_shards_are_linked_not_copied(
    rendered: RenderedSet, undisturbed: tuple[Path, Path]
) -> None:
    scratch, out = undisturbed
    for shard in rendered.shards(scratch / rendered.fingerprint()):
        assert shard.path.samefile(out / shard.path.name)


def test_the_images_do_not_depend_on_the_number_of_workers(
    rendered: RenderedSet, undisturbed: tuple[Path, Path], tmp_path: Path
) -> None:
    render_set(rendered, tmp_path / "scratch", tmp_path / "out", workers=1)
    assert contents(tmp_path / "out") == contents(undisturbed[1])


def test_a_finished_set_is_not_rendered_again(
    rendered: RenderedSet, undisturbed: tuple[Path, Path], tmp_path: Path
) -> None:
    scratch, out = undisturbed
    before = {path: identity(path) for path in sorted(scratch.rglob("*"))}
    render_set(rendered, scratch, tmp_path / "out", workers=2)
    assert {path: identity(path) for path in sorted(scratch.rglob("*"))} == before
    assert contents(tmp_path / "out") == contents(out)


def test_an_interrupted_run_continues_to_the_same_bytes(
    rendered: RenderedSet, undisturbed: tuple[Path, Path], tmp_path: Path
) -> None:
    process = start_python(
        RENDER_SET,
        tmp_path,
        rendered.settings,
        backgrounds=[(str(path), source) for path, source in rendered.backgrounds.items()],
        seed=rendered.seed,
        images=IMAGES,
        per_shard=PER_SHARD,
    )
    shards = rendered.shards(tmp_path / "scratch" / rendered.fingerprint())
    kill_once_exists(process, shards[0].path)
    assert [shard.path.exists() for shard in shards] == [True, False, False]
    assert not (tmp_path / "out").exists()
    before = identity(shards[0].path)

    render_set(rendered, tmp_path / "scratch", tmp_path / "out", workers=2)
    assert identity(shards[0].path) == before
    assert contents(tmp_path / "out") == contents(undisturbed[1])


def kill_once_exists(process: subprocess.Popen[str], path: Path) -> None:
    """Kill a process with all its workers as soon as `path` exists."""
    end = time.monotonic() + 90
    while not path.exists() and process.poll() is None and time.monotonic() < end:
        time.sleep(0.02)
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)
    output, _ = process.communicate(timeout=30)
    assert process.returncode == -signal.SIGKILL, output
    assert path.exists(), output


@pytest.fixture
def finished(rendered: RenderedSet, undisturbed: tuple[Path, Path], tmp_path: Path) -> list[Shard]:
    """The shards of `undisturbed` once more, in `tmp_path/scratch`."""
    shutil.copytree(undisturbed[0], tmp_path / "scratch")
    return rendered.shards(tmp_path / "scratch" / rendered.fingerprint())


def test_what_a_dead_worker_left_is_removed(
    rendered: RenderedSet, undisturbed: tuple[Path, Path], finished: list[Shard], tmp_path: Path
) -> None:
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    path = finished[0].path
    path.unlink()
    remains = path.with_name(f"{path.name}.{socket.gethostname()}.{dead.pid}.part")
    remains.write_bytes(b"half a shard" * 100_000)
    render_set(rendered, tmp_path / "scratch", tmp_path / "out", workers=1)
    assert not list(path.parent.glob("*.part"))
    assert contents(tmp_path / "out") == contents(undisturbed[1])


def cut_short(path: Path) -> None:
    """Truncate a file in place, as a full disk or an interrupted copy does."""
    os.truncate(path, path.stat().st_size // 2)


def test_a_truncated_shard_in_scratch_is_rendered_again(
    rendered: RenderedSet,
    undisturbed: tuple[Path, Path],
    finished: list[Shard],
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:
    cut_short(finished[1].path)
    others = [identity(shard.path) for shard in (finished[0], finished[2])]
    with caplog.at_level(logging.WARNING, logger=scale_out.__name__):
        render_set(rendered, tmp_path / "scratch", tmp_path / "out", workers=1)
    assert [record.getMessage() for record in caplog.records] == [
        f"{finished[1].path} is truncated or damaged: rendering it again"
    ]
    assert contents(tmp_path / "out") == contents(undisturbed[1])
    assert [identity(shard.path) for shard in (finished[0], finished[2])] == others


def test_a_truncated_shard_in_out_is_mended_by_running_again(
    rendered: RenderedSet, undisturbed: tuple[Path, Path], finished: list[Shard], tmp_path: Path
) -> None:
    out, shard = tmp_path / "out", finished[0].path
    render_set(rendered, tmp_path / "scratch", out, workers=1)
    cut_short(out / shard.name)
    assert shard.read_bytes() == (out / shard.name).read_bytes()  # one file, two names
    with pytest.raises(InputError, match="dvc repro -f render"):
        ShardedDataset(out)
    render_set(rendered, tmp_path / "scratch", out, workers=1)
    assert contents(out) == contents(undisturbed[1])
    assert shard.read_bytes() == (undisturbed[1] / shard.name).read_bytes()
    assert shard.samefile(out / shard.name)


def test_two_runs_in_one_scratch_folder_do_not_disturb_each_other(
    rendered: RenderedSet, undisturbed: tuple[Path, Path], tmp_path: Path
) -> None:
    one_shard = replace(rendered, images=PER_SHARD)
    outs = [tmp_path / "out", tmp_path / "other"]
    with ThreadPoolExecutor() as pool:
        runs = [pool.submit(render_set, one_shard, tmp_path / "scratch", o, 1) for o in outs]
    for run, out in zip(runs, outs, strict=True):
        run.result()
        first = rendered.shards(out)[0].path
        assert contents(out) == {first.name: (undisturbed[1] / first.name).read_bytes()}
    left = {path.suffix for path in (tmp_path / "scratch" / one_shard.fingerprint()).iterdir()}
    assert left == {".tar", ".log"}


def test_another_run_may_have_linked_a_shard_just_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    link, path = os.link, tmp_path / "shard-000000.tar"
    path.write_bytes(b"a shard")

    def link_twice(source: Path, target: Path) -> None:
        link(source, target)
        link(source, target)

    monkeypatch.setattr(os, "link", link_twice)
    link_shards([Shard(path, 0, 1)], tmp_path / "out")
    assert path.samefile(tmp_path / "out" / path.name)


def test_a_failing_worker_names_the_file_and_keeps_finished_shards(
    with_scene: Callable[..., RenderSettings], backgrounds: Mapping[Path, str], tmp_path: Path
) -> None:
    good, bad = next(iter(backgrounds)), tmp_path / "broken.jpg"
    bad.write_bytes(b"this is no picture")
    files = {good: "good", bad: "bad"}
    settings = replace(with_scene(instruments=(1, 1)), samples=1)
    rendered = RenderedSet(settings, files, good_then_bad(settings, good, bad), 2, 1)
    with pytest.raises(InputError, match="not a readable image") as caught:
        render_set(rendered, tmp_path / "scratch", tmp_path / "out", workers=1)
    assert str(bad) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not str(caught.value).startswith("error")
    first, second = rendered.shards(tmp_path / "scratch" / rendered.fingerprint())
    assert ShardedDataset(first.path.parent).keys == [sample_key(0)]
    assert not second.path.exists()
    assert not list(first.path.parent.glob("*.part"))
    assert not (tmp_path / "out").exists()


def good_then_bad(settings: RenderSettings, good: Path, bad: Path) -> int:
    """A seed whose first image shows the one background and whose second the other."""

    def shown(seed: int) -> list[Path]:
        sampler = SceneSampler(settings, (good, bad), seed)
        return [next(sampler.candidates(index)).background for index in range(2)]

    return next(seed for seed in range(100) if shown(seed) == [good, bad])


def test_a_worker_that_crashes_leaves_its_log(
    rendered: RenderedSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # No InputError: a background that vanishes while the set is rendered.
    monkeypatch.setattr(RenderedSet, "fingerprint", lambda self: "constant")
    gone = replace(rendered, backgrounds={tmp_path / "gone.jpg": "s"}, images=1)
    with pytest.raises(InputError, match=r"shard-000000\.tar failed; see .*\.log") as caught:
        render_set(gone, tmp_path / "scratch", tmp_path / "out", workers=1)
    log = Path(str(caught.value).rpartition("see ")[2])
    assert "gone.jpg" in log.read_text()


# Instead of a worker: the first waits for the second to be there, then fails; the second would go
# on for ten minutes.
FAIL_OR_GO_ON = """
import sys, time
from pathlib import Path
log = Path(sys.argv[1])
there = log.with_name("there")
if log.name == "shard-000000.log":
    while not there.exists():
        time.sleep(0.02)
    sys.exit(1)
there.touch()
time.sleep(600)
"""


def test_a_failure_stops_all_other_workers(
    rendered: RenderedSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[subprocess.Popen[str]] = []

    class Recorded(subprocess.Popen[str]):
        def __init__(self, *arguments: Any, **options: Any) -> None:
            super().__init__(*arguments, **options)
            started.append(self)

    monkeypatch.setattr(subprocess, "Popen", Recorded)
    monkeypatch.setattr(
        scale_out, "_command", lambda job, log: [sys.executable, "-c", FAIL_OR_GO_ON, str(log)]
    )
    two_shards = replace(rendered, images=2 * PER_SHARD)
    with pytest.raises(InputError, match=r"shard-000000\.tar failed"):
        render_set(two_shards, tmp_path / "scratch", tmp_path / "out", workers=2)
    assert sorted(process.returncode for process in started) == [-signal.SIGTERM, 1]
    assert not (tmp_path / "out").exists()


def test_fingerprint_changes_with_whatever_changes_the_images(
    rendered: RenderedSet, tmp_path: Path
) -> None:
    path, *others = rendered.backgrounds
    same_name = tmp_path / path.name
    same_name.write_bytes(path.read_bytes() + b"\0")
    altered = {same_name: rendered.backgrounds[path]} | {
        other: rendered.backgrounds[other] for other in others
    }
    lens = replace(rendered.settings.lens, noise=(0.0, 0.1))
    changed = [
        rendered,
        replace(rendered, seed=18),
        replace(rendered, images=IMAGES + 1),
        replace(rendered, images_per_shard=PER_SHARD + 1),
        replace(rendered, settings=replace(rendered.settings, samples=3)),
        replace(rendered, settings=replace(rendered.settings, lens=lens)),
        replace(rendered, backgrounds=altered),
        replace(rendered, backgrounds=dict(reversed(rendered.backgrounds.items()))),
    ]
    assert len({each.fingerprint() for each in changed}) == len(changed)


def test_fingerprint_changes_with_the_content_of_a_cad_file(
    rendered: RenderedSet, tmp_path: Path
) -> None:
    path = tmp_path / "tool.stl"
    shaft = replace(rendered.settings.shaft, cad=CadSettings(path, "mm"))
    tool = replace(rendered, settings=replace(rendered.settings, shaft=shaft))
    with pytest.raises(InputError, match=r"tool\.stl: cannot be read"):
        tool.fingerprint()
    found = set()
    for length_mm in (80.0, 90.0):
        trimesh.creation.cylinder(1.5, length_mm).export(path)
        instrument_shape.cache_clear()  # of this process: a run reads the file once
        found.add(tool.fingerprint())
    assert len(found) == 2


def test_fingerprint_does_not_depend_on_where_the_backgrounds_lie(
    rendered: RenderedSet, tmp_path: Path
) -> None:
    moved = {}
    for path, source in rendered.backgrounds.items():
        moved[tmp_path / path.name] = source
        (tmp_path / path.name).write_bytes(path.read_bytes())
    assert replace(rendered, backgrounds=moved).fingerprint() == rendered.fingerprint()


def test_fingerprint_covers_all_code_that_makes_the_bytes() -> None:
    root = Path(jobs.__file__).parents[1]
    covered = {path for pattern in jobs._SOURCES for path in root.glob(pattern)}
    # images.py decodes the background and encodes the JPEG.
    needed = {root / name for name in ("geometry.py", "shards.py", "images.py")}
    assert needed | set((root / "rendering").glob("*.py")) <= covered


def test_shards_cover_all_images_once(rendered: RenderedSet, tmp_path: Path) -> None:
    shards = replace(rendered, images=7, images_per_shard=3).shards(tmp_path)
    assert [(s.path.name, s.first, s.count) for s in shards] == [
        ("shard-000000.tar", 0, 3),
        ("shard-000001.tar", 3, 3),
        ("shard-000002.tar", 6, 1),
    ]
