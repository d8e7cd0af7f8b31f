"""Whole sets rendered by worker processes: the same bytes whatever happens on the way."""

import os
import signal
import subprocess
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import pytest
from blender_process import start_python

from shaftpose.config import RenderSettings
from shaftpose.errors import InputError
from shaftpose.rendering import jobs
from shaftpose.rendering.jobs import RenderedSet
from shaftpose.rendering.scale_out import render_set
from shaftpose.rendering.scene import SceneSampler
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


def test_the_remains_of_a_killed_worker_are_overwritten(
    rendered: RenderedSet, undisturbed: tuple[Path, Path], tmp_path: Path
) -> None:
    shards = rendered.shards(tmp_path / "scratch" / rendered.fingerprint())
    shards[0].path.parent.mkdir(parents=True)
    for shard in shards[1:]:
        shard.path.write_bytes((undisturbed[1] / shard.path.name).read_bytes())
    shards[0].path.with_suffix(".tar.part").write_bytes(b"half a shard" * 100_000)
    render_set(rendered, tmp_path / "scratch", tmp_path / "out", workers=1)
    assert contents(tmp_path / "out") == contents(undisturbed[1])


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


def test_a_failure_stops_all_other_workers(
    settings: RenderSettings, backgrounds: Mapping[Path, str], tmp_path: Path
) -> None:
    good, bad = next(iter(backgrounds)), tmp_path / "broken.jpg"
    bad.write_bytes(b"this is no picture")
    files = {bad: "bad", good: "good"}
    settings = replace(settings, samples=1)
    # The first shard fails at once; the others would be rendered for minutes.
    rendered = RenderedSet(settings, files, good_then_bad(settings, bad, good), 2000, 1000)
    before = time.monotonic()
    with pytest.raises(InputError, match="not a readable image"):
        render_set(rendered, tmp_path / "scratch", tmp_path / "out", workers=1)
    assert time.monotonic() - before < 30


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
