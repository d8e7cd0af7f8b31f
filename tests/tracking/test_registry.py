"""The registered model's candidate and champion."""

from pathlib import Path

import mlflow
import pytest
from mlflow.entities.model_registry import ModelVersion

from shaftpose.tracking.trainings import log_results
from tests.tracking.registering import export, register


def test_a_candidate_without_model_is_passed_over(
    store: Path, caplog: pytest.LogCaptureFixture
) -> None:
    log_results("id-3", "c", {"mAP": 0.25}, {})
    register("id-3")
    assert "lacks its model" in caplog.text
    assert not mlflow.MlflowClient().search_registered_models()


def version(alias: str) -> ModelVersion:
    return mlflow.MlflowClient().get_model_version_by_alias("shaftpose", alias)


def versions() -> tuple[int, int]:
    """The versions of champion and candidate."""
    return int(version("champion").version), int(version("candidate").version)


def exported() -> list[str]:
    """The URIs of the models of the only run."""
    (run,) = mlflow.search_runs(output_format="list")
    return [f"models:/{output.model_id}" for output in run.outputs.model_outputs]


def test_a_champion_is_registered_once(store: Path, constant_model: Path) -> None:
    for name in ("id-4", "id-5"):
        export(name, constant_model)
    found = []
    for name in ("id-4", "id-4", "id-5"):
        register(name)
        found.append(versions())
    assert found == [(1, 1), (1, 1), (2, 2)]


def test_a_champion_is_not_compared_with_itself(
    store: Path, constant_model: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO")
    export("id-7", constant_model)
    for _ in range(2):
        register("id-7", lambda other: False)
    assert versions() == (1, 1)
    assert "not the champion" not in caplog.text


def test_a_champion_that_was_exported_again_is_registered_again(
    store: Path, constant_model: Path
) -> None:
    models = []
    for _ in range(2):
        export("id-6", constant_model)
        register("id-6")
        models.append(version("champion").source)
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
    register("id-7")
    assert version("champion").source == whole


@pytest.fixture
def two_models(store: Path, constant_model: Path) -> Path:
    """The models of two trainings, `id-1` and `id-2`, of which the first is champion."""
    for name in ("id-1", "id-2"):
        export(name, constant_model)
    register("id-1", mAP="0.9")
    return store


@pytest.mark.usefixtures("two_models")
def test_only_a_better_model_becomes_champion(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO")
    compared = []
    register("id-2", lambda other: bool(compared.append(other["mAP"])))
    assert (versions(), compared) == ((1, 2), ["0.9"])
    assert "version 2 (d) is the candidate, not the champion: version 1 is no worse" in caplog.text
    register("id-2")
    assert versions() == (2, 2)
    assert version("champion").description == "d: the rule"
    assert version("champion").tags == {"profile": "demo", "dataset": "aa"}


@pytest.mark.usefixtures("two_models")
def test_models_measured_on_other_images_are_not_compared(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO")
    register("id-2", dataset="bb")
    assert versions() == (1, 2)
    assert "version 1 was measured on other images" in caplog.text


@pytest.mark.usefixtures("two_models")
def test_smoke_runs_yield_no_champion() -> None:
    register("id-2", profile="smoke")
    assert versions() == (1, 2)


def test_experiments_of_dvc_yield_no_champion(
    store: Path, constant_model: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DVC_EXP_NAME", "vexed-tank")
    export("id-1", constant_model)
    register("id-1")
    assert int(version("candidate").version) == 1
    with pytest.raises(mlflow.MlflowException):
        version("champion")
