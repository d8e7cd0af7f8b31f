"""Where an unfinished training is kept, and what tells it from others."""

import sys
from copy import deepcopy
from pathlib import Path

import pytest

from tests.pipeline.conftest import ROOT
from tests.pipeline.test_configs import composed
from tests.pipeline.test_dvc_code import PLUMBING, reached
from tests.pipeline.test_dvc_inputs import parameters_listed

sys.path.insert(0, str(ROOT / "pipelines"))

import digests  # noqa: E402
import unfinished  # noqa: E402
from stage import Config  # noqa: E402

from shaftpose.errors import InputError  # noqa: E402
from shaftpose.shards import shard_name  # noqa: E402

# `defaults` chooses backbone and trainer, which are listed themselves; of the file at `start` the
# content counts, not the name.
WATCHED = sorted(set(parameters_listed("train")) - {"defaults", "variant.start"})


@pytest.fixture(scope="module")
def config() -> Config:
    return composed("profile=smoke")


def changed(config: Config, key: str) -> Config:
    """The configuration with another value of a dotted key."""
    changed = part = deepcopy(config)
    *parents, last = key.split(".")
    for parent in parents:
        part = part[parent]
    part[last] = "changed"
    return changed


def fingerprint(config: Config) -> str:
    return unfinished.fingerprint(config, digests.about_data(with_real=False, start=None))


@pytest.mark.parametrize("key", WATCHED)
def test_what_dvc_watches_makes_another_training(inside: Path, config: Config, key: str) -> None:
    assert fingerprint(changed(config, key)) != fingerprint(config)


@pytest.mark.parametrize(
    "key",
    [
        "out",
        "variant.title",
        "training.loader_workers",
        "training.checkpoint_minutes",
        "training.max_hours",
        "tracking.uri",
    ],
)
def test_what_changes_nothing_may_change_in_between(inside: Path, config: Config, key: str) -> None:
    assert fingerprint(changed(config, key)) == fingerprint(config)


def test_the_code_that_dvc_watches_is_hashed_and_no_other() -> None:
    hashed = {path.relative_to(ROOT).as_posix() for path in unfinished.code_files()}
    # Of the network's code all is watched: a variant's head may come in a file of its own.
    network = {path.relative_to(ROOT).as_posix() for path in ROOT.glob("src/*/network/*.py")}
    assert hashed == (reached("pipelines/train.py") - PLUMBING) | network


@pytest.mark.parametrize(
    ("name", "with_real"),
    [
        (f"data/render/images/{shard_name(1)}", False),
        ("data/split/train.csv", False),
        ("data/split/validation.csv", False),
        ("data/real/train.json", True),
        ("data/real/images/1.jpg", True),
    ],
)
def test_other_data_make_another_training(
    inside: Path, config: Config, name: str, with_real: bool
) -> None:
    before = unfinished.fingerprint(config, digests.about_data(with_real, start=None))
    content = (inside / name).read_bytes()
    (inside / name).write_bytes(content + b" ")
    after = unfinished.fingerprint(config, digests.about_data(with_real, start=None))
    (inside / name).write_bytes(content)
    assert after != before
    assert unfinished.fingerprint(config, digests.about_data(with_real, start=None)) == before


def test_another_detector_to_start_from_makes_another_training(
    config: Config, inside: Path, tmp_path: Path
) -> None:
    first, second, copy = (tmp_path / name for name in ("first", "second", "copy"))
    for path, content in ((first, b"1"), (second, b"2"), (copy, b"1")):
        path.mkdir()
        (path / "model.ckpt").write_bytes(content)
    prints = [
        unfinished.fingerprint(config, digests.about_data(False, path / "model.ckpt"))
        for path in (first, second, copy)
    ]
    assert prints[0] == prints[2] != prints[1]
    assert fingerprint(config) not in prints
    with pytest.raises(InputError, match="gone.ckpt: no such detector.*dvc repro detector"):
        digests.about_data(False, tmp_path / "gone.ckpt")


def test_an_interrupted_training_keeps_its_folder_and_its_id(tmp_path: Path) -> None:
    folder = tmp_path / "training" / "abc"
    with pytest.raises(KeyError), unfinished.kept(folder) as first:
        raise KeyError
    with unfinished.kept(folder) as second:
        assert folder.is_dir()
    assert first == second
    assert not folder.exists()
    with unfinished.kept(folder) as third:
        pass
    assert third != first


def test_two_processes_do_not_share_a_training(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(unfinished, "_PATIENCE_S", 0.0)
    with (
        unfinished.kept(tmp_path / "abc"),
        pytest.raises(InputError, match="abc.lock: another process"),
        unfinished.kept(tmp_path / "abc"),
    ):
        pass
