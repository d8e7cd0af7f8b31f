"""Exported models in MLflow, and the champion."""

from pathlib import Path

import mlflow
import numpy as np
import onnx
import pytest
from mlflow.entities.model_registry import ModelVersion

from shaftpose.core.errors import InputError
from shaftpose.tracking.models import log_model, register_champion, registered_model
from shaftpose.tracking.trainings import log_results


def test_a_champion_without_model_is_passed_over(
    store: Path, caplog: pytest.LogCaptureFixture
) -> None:
    log_results("id-3", "c", {"mAP": 0.25}, {})
    register_champion("id-3", "c", "the rule")
    assert "lacks its model" in caplog.text
    assert not mlflow.MlflowClient().search_registered_models()


def export(training_id: str, model: Path) -> None:
    log_model(training_id, "d", model, np.zeros((1, 299, 299, 3), dtype=np.uint8))


def champion() -> ModelVersion:
    return mlflow.MlflowClient().get_model_version_by_alias("shaftpose", "champion")


def exported() -> list[str]:
    """The URIs of the models of the only run."""
    (run,) = mlflow.search_runs(output_format="list")
    return [f"models:/{output.model_id}" for output in run.outputs.model_outputs]


def test_a_champion_is_registered_once(store: Path, constant_model: Path) -> None:
    for name in ("id-4", "id-5"):
        export(name, constant_model)
    versions = []
    for name in ("id-4", "id-4", "id-5"):
        register_champion(name, "d", "the rule")
        versions.append(champion().version)
    assert [int(version) for version in versions] == [1, 1, 2]


def test_a_champion_that_was_exported_again_is_registered_again(
    store: Path, constant_model: Path
) -> None:
    models = []
    for _ in range(2):
        export("id-6", constant_model)
        register_champion("id-6", "d", "the rule")
        models.append(champion().source)
    assert set(models) == set(exported())
    assert len(set(models)) == 2


def test_a_model_that_failed_or_was_deleted_is_no_champion(
    store: Path, constant_model: Path
) -> None:
    client, models = mlflow.MlflowClient(), []
    for _ in range(3):
        export("id-7", constant_model)
        (new,) = set(exported()) - set(models)
        models.append(new)
    whole, failed, deleted = models
    client.finalize_logged_model(failed.removeprefix("models:/"), "FAILED")
    client.delete_logged_model(deleted.removeprefix("models:/"))
    register_champion("id-7", "d", "the rule")
    assert champion().source == whole


def test_a_champion_is_loaded_for_prediction(store: Path, constant_model: Path) -> None:
    export("id-9", constant_model)
    register_champion("id-9", "d", "the rule")
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
