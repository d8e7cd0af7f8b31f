"""Exported models in MLflow."""

from pathlib import Path

import onnx
import pytest

from shaftpose.core.errors import InputError
from shaftpose.tracking.models import registered_model
from tests.tracking.registering import export, register


def test_a_champion_is_loaded_for_prediction(store: Path, constant_model: Path) -> None:
    export("id-9", constant_model)
    register("id-9")
    for name in ("shaftpose@champion", "shaftpose/1"):
        with registered_model(name) as path:
            assert onnx.load(str(path)) == onnx.load(str(constant_model))
        assert not path.exists()


def test_a_model_that_is_not_registered_is_named(
    store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with (
        pytest.raises(InputError, match="^mlflow:/other@champion: cannot be loaded .*other"),
        registered_model("other@champion"),
    ):
        pass
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)  # MLflow sets it
    with (
        pytest.raises(InputError, match="shaftpose@champion: there is no .*/elsewhere/mlflow.db"),
        registered_model("shaftpose@champion"),
    ):
        pass
    assert not list(Path.cwd().iterdir())
