"""The model bundled with the package."""

import shutil
import tomllib
from pathlib import Path

import pytest

from shaftpose.deployment import bundled
from shaftpose.deployment.bundled import CHECKSUM, MODEL, bundled_model, checksum
from shaftpose.deployment.model_facts import ModelFacts
from shaftpose.deployment.onnx_export import store_facts
from shaftpose.deployment.predictor import Predictor
from shaftpose.errors import InputError
from studies.model_frames import complaints

ROOT = Path(__file__).parents[2]
FRAMES = ROOT / "tests/data/bundled_model"


@pytest.fixture
def folder(constant_model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The package's folder of models, with another model in it."""
    folder = tmp_path / "models"
    folder.mkdir()
    shutil.copy(constant_model, folder / MODEL)
    (folder / CHECKSUM).write_bytes(checksum(folder / MODEL))
    monkeypatch.setattr(bundled, "FOLDER", folder)
    return folder


def test_a_whole_model_is_found(folder: Path) -> None:
    assert bundled_model() == folder / MODEL


@pytest.mark.parametrize("name", [MODEL, CHECKSUM])
def test_a_missing_file_is_named_with_the_remedy(folder: Path, name: str) -> None:
    (folder / name).unlink()
    with pytest.raises(InputError, match=rf"/{name}: missing; reinstall the package"):
        bundled_model()


def test_damage_is_found_where_the_file_still_loads(folder: Path) -> None:
    store_facts(folder / MODEL, ModelFacts(0.75, 95.0, 3.0))
    assert Predictor(folder / MODEL).confidence == 0.75
    with pytest.raises(InputError, match=rf"/{MODEL}: damaged.*; reinstall the package"):
        bundled_model()


def test_the_checksum_is_that_of_sha256sum(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"abc")
    digest = b"ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    assert checksum(tmp_path / "a") == digest + b"  a\n"


def test_wheels_hold_the_model() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert "models/*" in settings["tool"]["setuptools"]["package-data"]["shaftpose"]
    assert ROOT / "src/shaftpose/models" == bundled.FOLDER


@pytest.mark.skipif(
    not FRAMES.is_dir(), reason="no model is bundled yet: run python -m studies.bundle_model"
)
def test_the_bundled_model_keeps_to_its_bounds() -> None:
    assert complaints(Predictor(bundled_model()), FRAMES) == []
