"""Parts of a rendered set, and the fingerprint that names it in scratch."""

import errno
import multiprocessing
import os
import resource
import signal
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest
import trimesh

import shaftpose
from shaftpose.core.errors import InputError
from shaftpose.farm.set_folder import (
    link_shards,
    matches_checksum,
    read_set,
    record_checksum,
    write_set,
)
from shaftpose.rendering import rendered_set
from shaftpose.rendering.rendered_set import RenderedSet, Shard
from shaftpose.rendering.shapes import instrument_shape
from shaftpose.settings.schema import CadSettings, RenderSettings
from shaftpose.source_code import source_files


@pytest.fixture(scope="module")
def rendered(settings: RenderSettings, backgrounds: Mapping[Path, str]) -> RenderedSet:
    return RenderedSet(settings, backgrounds, seed=17, images=6, images_per_shard=2)


def test_shards_cover_all_images_once(rendered: RenderedSet, tmp_path: Path) -> None:
    shards = replace(rendered, images=7, images_per_shard=3).shards(tmp_path)
    assert [(s.path.name, s.first, s.count) for s in shards] == [
        ("shard-000000.tar", 0, 3),
        ("shard-000001.tar", 3, 3),
        ("shard-000002.tar", 6, 1),
    ]


def test_a_changed_shard_is_noticed(tmp_path: Path) -> None:
    shard, killed = tmp_path / "shard-000000.tar", tmp_path / "shard-000001.tar"
    for path in (shard, killed):
        path.write_bytes(b"images")
    record_checksum(shard)
    for path in (shard, killed):  # the second one has no record yet
        assert matches_checksum(path)
        path.write_bytes(b"imagez")
        assert not matches_checksum(path)


def test_a_set_is_read_as_it_was_written_wherever_the_reader_stands(
    rendered: RenderedSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(next(iter(rendered.backgrounds)).parent)
    names = {Path(path.name): source for path, source in rendered.backgrounds.items()}
    write_set(replace(rendered, backgrounds=names), tmp_path)
    monkeypatch.chdir(tmp_path)
    found = read_set(tmp_path)
    assert found == rendered
    assert list(found.backgrounds) == list(rendered.backgrounds)  # the order matters, too


def test_a_cad_file_is_found_wherever_the_reader_stands(
    rendered: RenderedSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shaft = replace(rendered.settings.shaft, cad=CadSettings(Path("tool.stl"), "mm"))
    settings = replace(rendered.settings, shaft=shaft)
    write_set(replace(rendered, settings=settings), tmp_path)
    cad = read_set(tmp_path).settings.shaft.cad
    assert cad == CadSettings(tmp_path / "tool.stl", "mm")


def test_shards_of_an_earlier_larger_set_go_and_nothing_else_does(tmp_path: Path) -> None:
    out, path = tmp_path / "out", tmp_path / "shard-000000.tar"
    path.write_bytes(b"a shard")
    out.mkdir()
    for name in ("shard-000000.tar", "shard-000001.tar", "shard-notes.tar", "notes.txt"):
        (out / name).write_bytes(b"earlier")
    link_shards([Shard(path, 0, 1)], out)
    assert {p.name for p in out.iterdir()} == {"shard-000000.tar", "shard-notes.tar", "notes.txt"}
    assert (out / path.name).read_bytes() == b"a shard"


def test_shards_of_other_settings_are_all_gone_before_the_first_new_one_comes(
    tmp_path: Path,
) -> None:
    out, missing = tmp_path / "out", tmp_path / "shard-000000.tar"
    out.mkdir()
    for number in range(2):
        (out / f"shard-{number:06d}.tar").write_bytes(b"earlier")
    with pytest.raises(FileNotFoundError):
        link_shards([Shard(missing, 0, 1)], out)
    assert list(out.iterdir()) == []


def link_until_killed(shard: Shard, out: Path, bytes_written: int) -> None:
    """Link a shard in a process that the system kills when a file reaches a number of bytes."""
    signal.signal(signal.SIGXFSZ, signal.SIG_DFL)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_FSIZE, (bytes_written, bytes_written))
    link_shards([shard], out)


def test_a_run_killed_while_it_copies_leaves_no_half_shard_under_its_final_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def other_file_system(source: Path, target: Path) -> None:
        raise OSError(errno.EXDEV, os.strerror(errno.EXDEV))

    monkeypatch.setattr(os, "link", other_file_system)
    path, out = tmp_path / "shard-000000.tar", tmp_path / "out"
    path.write_bytes(bytes(100_000))
    shard = Shard(path, 0, 1)
    killed = multiprocessing.get_context("fork").Process(
        target=link_until_killed, args=(shard, out, 60_000)
    )
    killed.start()
    killed.join()
    assert killed.exitcode == -signal.SIGXFSZ
    (part,) = out.iterdir()
    assert part.name == "shard-000000.tar.part"
    assert part.stat().st_size == 60_000

    link_shards([shard], out)
    assert [found.name for found in out.iterdir()] == [path.name]
    assert (out / path.name).read_bytes() == path.read_bytes()


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
        replace(rendered, images=7),
        replace(rendered, images_per_shard=3),
        replace(rendered, settings=replace(rendered.settings, samples=(2, 9))),
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


def test_the_fingerprint_covers_the_code_that_makes_the_bytes_and_no_other() -> None:
    """A changed message in the farm must not invalidate finished shards."""
    root = Path(shaftpose.__file__).parent
    covered = {p.relative_to(root).as_posix() for p in source_files(rendered_set.MODULES)}
    # samples.py encodes the files of an image; images.py decodes the background.
    assert {
        f"core/{name}.py" for name in ("geometry", "samples", "shard_writer", "images")
    } <= covered
    computing = {p.name for p in (root / "rendering").glob("*.py")} - {"__init__.py"}
    # A set's plan enters the fingerprint by value; silhouettes, BOP's models and a warning are no
    # images.
    others = {"rendered_set.py", "image_sets.py", "stand_in_sets.py", "silhouette.py",
              "bop_models.py", "handle_ends.py"}  # fmt: skip
    assert {name for name in covered if name.startswith("rendering/")} == {
        f"rendering/{name}" for name in computing - others
    }
    assert {name.split("/")[0] for name in covered} == {"core", "rendering"}
