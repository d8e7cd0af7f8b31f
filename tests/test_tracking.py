import re
from pathlib import Path

import mlflow
import numpy as np
import onnx
import pytest
from mlflow.entities.model_registry import ModelVersion

from shaftpose import tracking
from shaftpose.core.errors import InputError


def test_a_queued_experiment_tracks_in_the_users_own_copy() -> None:
    assert tracking.workspace(Path("/home/me/p/.dvc/tmp/exps/tmpab12")) == Path("/home/me/p")
    assert tracking.workspace(Path("/home/me/p")) == Path("/home/me/p")


@pytest.mark.parametrize(
    "uri",
    [
        "http://127.0.0.1:9",  # the port to which nobody listens
        "sqlite:////proc/none/mlflow.db",
        "none://127.0.0.1",
    ],
)
@pytest.mark.usefixtures("store")
def test_a_store_that_cannot_be_used_is_named(uri: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "0")
    with pytest.raises(InputError, match=rf"^MLflow at {re.escape(uri)}, experiment trials: "):
        tracking.connect(uri, "trials")


def test_a_deleted_experiment_is_named(store: Path) -> None:
    client = mlflow.MlflowClient()
    client.delete_experiment(client.get_experiment_by_name("trials").experiment_id)
    with pytest.raises(InputError, match="experiment trials: .*deleted"):
        tracking.connect(None, "trials")


def test_the_datasets_hashes_come_from_the_lock_file(tmp_path: Path) -> None:
    lock = tmp_path / "dvc.lock"
    assert tracking.dataset_identity(lock) == {}
    lock.write_text(
        "stages:\n"
        "  render:\n    outs:\n    - {path: data/render, md5: aa.dir}\n"
        "  train@c:\n    outs:\n    - {path: models/c/model.ckpt, md5: bb}\n"
        "  report:\n    outs:\n    - {path: reports/ablation.html, md5: cc}\n"
    )
    assert tracking.dataset_identity(lock) == {"data/render": "aa.dir"}


def test_a_lock_file_that_is_being_written_is_read_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lock = tmp_path / "dvc.lock"
    lock.write_text("stages:\n  render:\n    outs: [{path: data")
    whole = "stages:\n  render:\n    outs:\n    - {path: data/render, md5: aa.dir}\n"
    monkeypatch.setattr(tracking.time, "sleep", lambda seconds: lock.write_text(whole))
    assert tracking.dataset_identity(lock) == {"data/render": "aa.dir"}


def test_a_lock_file_that_stays_unreadable_does_not_stop_a_training(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    lock = tmp_path / "dvc.lock"
    lock.touch()
    monkeypatch.setattr(tracking.time, "sleep", lambda seconds: None)
    assert tracking.dataset_identity(lock) == {}
    assert "cannot be read" in caplog.text


def test_results_find_the_run_of_their_training(store: Path) -> None:
    with tracking.training_run("id-1", "d", {"loss": {"alpha": 2}}, {"data/render": "aa"}, store):
        mlflow.log_metric("training/loss", 3.0)
    picture = store / "picture.txt"
    picture.write_text("x")
    tracking.log_results("id-1", "d", {"mAP": 0.5, "fps": None}, {"picture": picture})
    (run,) = mlflow.search_runs(experiment_names=["trials"], output_format="list")
    assert run.data.metrics["mAP"] == 0.5
    assert "fps" not in run.data.metrics
    assert run.data.params["loss.alpha"] == "2"
    assert run.data.tags["dataset.data/render"] == "aa"
    assert run.inputs.dataset_inputs[0].dataset.digest == "aa"
    assert (store / "mlflow.db").is_file()
    assert list((store / "mlruns").rglob("picture.txt"))


def test_results_without_a_run_get_one(store: Path) -> None:
    # As after `dvc pull` on another machine: the models exist, the database does not.
    tracking.log_results("id-2", "c", {"mAP": 0.25}, {})
    tracking.log_results("id-2", "c", {"iou": 0.5}, {})
    (run,) = mlflow.search_runs(experiment_names=["trials"], output_format="list")
    assert run.info.run_name == "c"
    assert {"mAP", "iou"} <= run.data.metrics.keys()


def test_runs_of_a_sweep_are_nested(store: Path) -> None:
    folder = store / "sweeps" / "today"
    tracking.start_sweep(folder, "sweep today")
    for number in range(2):
        with tracking.training_run(f"id-{number}", "d", {}, {}, folder):
            pass
    runs = mlflow.search_runs(experiment_names=["trials"], output_format="list")
    parents = [run for run in runs if "shaftpose.sweep" in run.data.tags]
    children = [run for run in runs if "mlflow.parentRunId" in run.data.tags]
    assert len(parents) == 1
    assert len(children) == 2
    assert {c.data.tags["mlflow.parentRunId"] for c in children} == {parents[0].info.run_id}


def test_a_sweep_that_goes_on_keeps_its_parent_run(store: Path) -> None:
    folder = store / "sweeps" / "today"
    for name in ("id-1", "id-2", "id-2"):  # the second one was interrupted
        tracking.start_sweep(folder, "sweep today")
        with tracking.training_run(name, "d", {"job": name}, {}, folder):
            pass
    assert len(tracking.sweep_runs(folder)) == 2
    assert len(mlflow.search_runs(experiment_names=["trials"], output_format="list")) == 3


def test_a_sweep_gets_a_parent_run_where_the_database_lacks_it(store: Path) -> None:
    folder = store / "sweeps" / "today"
    tracking.start_sweep(folder, "sweep today")
    tracking.connect(f"sqlite:///{store / 'other.db'}", "trials")
    tracking.start_sweep(folder, "sweep today")
    with tracking.training_run("id-1", "d", {}, {}, folder):
        pass
    assert len(tracking.sweep_runs(folder)) == 1


def test_trainings_of_a_sweep_are_found_from_its_folder(store: Path) -> None:
    folder = store / "sweeps" / "today"
    tracking.start_sweep(folder, "sweep today")
    with tracking.training_run("elsewhere", "d", {"seed": 1}, {}, store):
        pass
    for number, alpha in enumerate((0.5, 1.5)):
        parameters = {"loss": {"alpha": alpha}}
        with tracking.training_run(f"id-{number}", "d", parameters, {}, folder):
            mlflow.log_metrics({"validation/mAP": 0.9, "training/box": 2.0}, step=2)
            mlflow.log_metrics({"validation/mAP": alpha / 10}, step=3)
    runs = tracking.sweep_runs(folder)
    assert [run.parameters for run in runs] == [{"loss.alpha": "0.5"}, {"loss.alpha": "1.5"}]
    assert [run.metrics["validation/mAP"] for run in runs] == pytest.approx([0.05, 0.15])


def test_of_trainings_with_the_same_parameters_the_last_one_counts(store: Path) -> None:
    tracking.start_sweep(store, "sweep")
    for number, value in enumerate((0.25, 0.5)):  # in between, the code was changed
        with tracking.training_run(f"id-{number}", "d", {"alpha": 0.5}, {}, store):
            mlflow.log_metrics({"validation/mAP": value}, step=2)
    assert [run.metrics for run in tracking.sweep_runs(store)] == [{"validation/mAP": 0.5}]


def test_metrics_of_a_training_are_all_of_its_last_validation(store: Path) -> None:
    tracking.start_sweep(store, "sweep")
    with tracking.training_run("id-1", "d", {}, {}, store):
        mlflow.log_metrics({"validation/mAP": 0.5, "validation/tip_mm": 4.0}, step=2)
        mlflow.log_metrics({"validation/mAP": 0.0}, step=3)  # no correct detection any more
    tracking.log_results("id-1", "d", {"tip_mm": 3.0}, {})  # of the test images
    assert [run.metrics for run in tracking.sweep_runs(store)] == [{"validation/mAP": 0.0}]


def test_only_a_training_that_came_to_its_end_is_finished(store: Path) -> None:
    tracking.start_sweep(store, "sweep")
    with pytest.raises(RuntimeError), tracking.training_run("id-1", "d", {"a": 1}, {}, store):
        raise RuntimeError
    with tracking.training_run("id-2", "d", {"a": 2}, {}, store):
        assert [run.finished for run in tracking.sweep_runs(store)] == [False, False]
    assert [run.finished for run in tracking.sweep_runs(store)] == [False, True]


def test_a_folder_without_a_sweep_is_named(store: Path) -> None:
    with pytest.raises(InputError, match=r"mlflow_parent\.txt: missing"):
        tracking.sweep_runs(store)


def test_a_champion_without_model_is_passed_over(
    store: Path, caplog: pytest.LogCaptureFixture
) -> None:
    tracking.log_results("id-3", "c", {"mAP": 0.25}, {})
    tracking.register_champion("id-3", "c", "the rule")
    assert "lacks its model" in caplog.text
    assert not mlflow.MlflowClient().search_registered_models()


def export(training_id: str, model: Path) -> None:
    tracking.log_model(training_id, "d", model, np.zeros((1, 299, 299, 3), dtype=np.uint8))


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
        tracking.register_champion(name, "d", "the rule")
        versions.append(champion().version)
    assert [int(version) for version in versions] == [1, 1, 2]


def test_a_champion_that_was_exported_again_is_registered_again(
    store: Path, constant_model: Path
) -> None:
    models = []
    for _ in range(2):
        export("id-6", constant_model)
        tracking.register_champion("id-6", "d", "the rule")
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
    tracking.register_champion("id-7", "d", "the rule")
    assert champion().source == whole


def test_a_champion_is_loaded_for_prediction(store: Path, constant_model: Path) -> None:
    export("id-9", constant_model)
    tracking.register_champion("id-9", "d", "the rule")
    for name in ("shaftpose@champion", "shaftpose/1"):
        with tracking.registered_model(name) as path:
            assert onnx.load(str(path)) == onnx.load(str(constant_model))
        assert not path.exists()


def test_a_model_that_is_not_registered_is_named(
    store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with (
        pytest.raises(InputError, match="^mlflow:/other@champion: cannot be loaded .*other"),
        tracking.registered_model("other@champion"),
    ):
        pass
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)  # MLflow sets it
    with (
        pytest.raises(InputError, match="shaftpose@champion: there is no .*/elsewhere/mlflow.db"),
        tracking.registered_model("shaftpose@champion"),
    ):
        pass
    assert not list(Path.cwd().iterdir())
