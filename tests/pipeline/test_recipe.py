"""The folder of an unfinished training, and the fingerprint that distinguishes trainings."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from shaftpose.core.errors import InputError
from shaftpose.core.images import write_jpeg
from shaftpose.core.shard_writer import shard_name
from shaftpose.image_files.reading import read_rgb
from shaftpose.training import resume
from shaftpose.training.fingerprint import data_record, fingerprint
from shaftpose.training.recipe import Recipe
from shaftpose.training.resume import LAST_CHECKPOINT, locked_training_folder
from tests.pipeline.conftest import recipe_with
from tests.pipeline.small_data import FOLDERS


@pytest.fixture(scope="module")
def recipe() -> Recipe:
    return recipe_with("profile=smoke")


def identity(recipe: Recipe) -> str:
    return fingerprint(recipe, data_record(FOLDERS, mixed_in=False, start=None))


def test_compared_trainings_have_one_camera_and_any_trainer(recipe: Recipe) -> None:
    closer = with_changes(recipe, {"camera": {"view_deg": 80.0}})
    assert closer.comparison_key() != recipe.comparison_key()
    distributed = with_changes(recipe, {"trainer": {"strategy": "ddp"}})
    assert distributed.comparison_key() == recipe.comparison_key()


def with_changes(recipe: Recipe, changed: dict[str, Any]) -> Recipe:
    """The recipe with values, or values inside its parts, replaced."""
    parts = {
        name: replace(getattr(recipe, name), **value) if isinstance(value, dict) else value
        for name, value in changed.items()
    }
    return replace(recipe, **parts)


@pytest.mark.parametrize(
    "name",
    [
        f"data/render/images/{shard_name(1)}",
        "data/split/train.csv",
        "data/split/validation.csv",
    ],
)
def test_other_data_make_another_training(inside: Path, recipe: Recipe, name: str) -> None:
    before = fingerprint(recipe, data_record(FOLDERS, False, start=None))
    content = (inside / name).read_bytes()
    (inside / name).write_bytes(content + b" ")
    after = fingerprint(recipe, data_record(FOLDERS, False, start=None))
    (inside / name).write_bytes(content)
    assert after != before
    assert fingerprint(recipe, data_record(FOLDERS, False, start=None)) == before


def test_another_real_image_makes_another_training(inside: Path, recipe: Recipe) -> None:
    image = inside / "data/real/images/1.jpg"
    before = fingerprint(recipe, data_record(FOLDERS, True, start=None))
    content = image.read_bytes()
    write_jpeg(255 - read_rgb(image), image)
    after = fingerprint(recipe, data_record(FOLDERS, True, start=None))
    image.write_bytes(content)
    assert after != before
    assert fingerprint(recipe, data_record(FOLDERS, True, start=None)) == before


def test_another_detector_to_start_from_makes_another_training(
    recipe: Recipe, inside: Path, tmp_path: Path
) -> None:
    first, second, copy = (tmp_path / name for name in ("first", "second", "copy"))
    for path, content in ((first, b"1"), (second, b"2"), (copy, b"1")):
        path.mkdir()
        (path / "model.ckpt").write_bytes(content)
    prints = [
        fingerprint(recipe, data_record(FOLDERS, False, path / "model.ckpt"))
        for path in (first, second, copy)
    ]
    assert prints[0] == prints[2] != prints[1]
    assert identity(recipe) not in prints
    with pytest.raises(InputError, match="gone.ckpt: no such detector.*dvc repro detector"):
        data_record(FOLDERS, False, tmp_path / "gone.ckpt")


def test_an_interrupted_training_keeps_its_checkpoint_and_its_id(tmp_path: Path) -> None:
    folder = tmp_path / "training" / "abc"
    with pytest.raises(KeyError), locked_training_folder(folder) as first:
        (folder / LAST_CHECKPOINT).touch()
        raise KeyError
    with locked_training_folder(folder) as second:
        assert (folder / LAST_CHECKPOINT).exists()
    assert first == second
    assert not (folder / LAST_CHECKPOINT).exists()


def test_two_processes_do_not_share_a_training(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(resume, "_PATIENCE_S", 0.0)
    with (
        locked_training_folder(tmp_path / "abc"),
        pytest.raises(InputError, match="abc.lock: another process"),
        locked_training_folder(tmp_path / "abc"),
    ):
        pass
