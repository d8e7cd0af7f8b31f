"""The model bundled with the package."""

import shutil
import tomllib
from pathlib import Path

import pytest

from shaftpose.core.errors import InputError
from shaftpose.export.onnx_export import store_metadata
from shaftpose.inference import model_files
from shaftpose.inference.model_files import (
    DEFAULT,
    ModelMetadata,
    bundled_model,
    bundled_names,
    checksum,
)
from shaftpose.inference.predictor import Predictor
from studies.model_frames import complaints

ROOT = Path(__file__).parents[2]
FRAMES = ROOT / "tests/data/bundled_models"
MODEL, CHECKSUM = "shaftpose.onnx", "shaftpose.onnx.sha256"


@pytest.fixture
def folder(constant_model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The package's folder of models, with another model in it."""
    folder = tmp_path / "models"
    folder.mkdir()
    shutil.copy(constant_model, folder / MODEL)
    (folder / CHECKSUM).write_bytes(checksum(folder / MODEL))
    monkeypatch.setattr(model_files, "FOLDER", folder)
    return folder


def test_a_whole_model_is_found(folder: Path) -> None:
    assert bundled_model() == folder / MODEL
    shutil.copy(folder / MODEL, folder / "another.onnx")
    assert bundled_names() == ["shaftpose", "another"]
    with pytest.raises(InputError, match=r"/another.onnx.sha256: missing; reinstall"):
        bundled_model("another")


@pytest.mark.parametrize("name", [MODEL, CHECKSUM])
def test_a_missing_file_is_named_with_the_remedy(folder: Path, name: str) -> None:
    (folder / name).unlink()
    with pytest.raises(InputError, match=rf"/{name}: missing; reinstall the package"):
        bundled_model()


def test_damage_is_found_where_the_file_still_loads(folder: Path) -> None:
    store_metadata(folder / MODEL, ModelMetadata(0.75, 95.0, 3.0))
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
    assert ROOT / "src/shaftpose/models" == model_files.FOLDER


@pytest.mark.parametrize("name", bundled_names())
def test_bundled_models_keep_to_their_bounds(name: str) -> None:
    if name != DEFAULT and not (FRAMES / name).is_dir():
        pytest.skip(f"{name} has no frames: its backgrounds belong to others")
    assert complaints(Predictor(bundled_model(name)), FRAMES / name) == []


def test_bundled_models_are_small_and_have_cards() -> None:
    models = [bundled_model(name) for name in bundled_names()]
    assert sum(model.stat().st_size for model in models) <= 8_000_000
    for model in models:
        assert model.with_suffix(".md").read_text().startswith(f"# Model card: {model.stem}\n")
