"""The MLflow run of a training."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import mlflow
import pytest
from mlflow.store.tracking.dbmodels.models import SqlDataset
from sqlalchemy import event

from shaftpose.tracking.connection import connect
from shaftpose.tracking.trainings import log_results, training_run


def test_results_find_the_run_of_their_training(store: Path) -> None:
    with training_run(
        "id-1", "d", {"loss": {"alpha": 2}}, {"data/render": "aa"}, "data/render", store
    ):
        mlflow.log_metric("train/loss", 3.0)
    picture = store / "picture.txt"
    picture.write_text("x")
    log_results("id-1", "d", {"mAP": 0.5, "fps": None}, {"picture": picture})
    (run,) = mlflow.search_runs(experiment_names=["trials"], output_format="list")
    assert run.data.metrics["mAP"] == 0.5
    assert "fps" not in run.data.metrics
    assert run.data.params["loss.alpha"] == "2"
    assert run.data.tags["dataset.data/render"] == "aa"
    assert run.inputs.dataset_inputs[0].dataset.digest == "aa"
    assert (store / "mlflow.db").is_file()
    assert list((store / "mlruns").rglob("picture.txt"))


def test_trainings_that_start_concurrently_share_their_images(store: Path) -> None:
    def start(name: str) -> None:
        with training_run(name, "d", {}, {"data/render": "aa"}, "data/render", store):
            pass

    started = []

    def start_another(*_: object) -> None:
        """Called when MLflow has looked for the images in vain, and before it adds them."""
        if not started:
            started.append("id-2")
            with ThreadPoolExecutor() as pool:  # MLflow keeps a stack of runs for each thread
                pool.submit(start, "id-2").result()

    event.listen(SqlDataset, "init", start_another)
    try:
        start("id-1")
    finally:
        event.remove(SqlDataset, "init", start_another)
    runs = mlflow.search_runs(experiment_names=["trials"], output_format="list")
    assert started
    assert [[data.dataset.digest for data in run.inputs.dataset_inputs] for run in runs] == [
        ["aa"],
        ["aa"],
    ]


def test_results_without_a_run_get_one(store: Path) -> None:
    # As after `dvc pull` on another machine: the models exist, the database does not.
    log_results("id-2", "c", {"mAP": 0.25}, {})
    log_results("id-2", "c", {"iou": 0.5}, {})
    (run,) = mlflow.search_runs(experiment_names=["trials"], output_format="list")
    assert run.info.run_name == "c"
    assert {"mAP", "iou"} <= run.data.metrics.keys()


def test_a_runs_duration_is_that_of_its_training(store: Path) -> None:
    with training_run("id-1", "d", {}, {}, "data/render", store, settings={"seed": 7}):
        pass
    (before,) = mlflow.search_runs(output_format="list")
    log_results("id-1", "d", {"test": {"mAP": 0.5}}, {})
    (after,) = mlflow.search_runs(output_format="list")
    assert after.info.end_time == before.info.end_time
    assert after.info.status == "FINISHED"
    assert after.data.metrics["test/mAP"] == 0.5
    assert mlflow.artifacts.load_text(f"{after.info.artifact_uri}/settings.yaml") == "seed: 7\n"


def test_a_training_goes_on_in_the_experiment_where_it_began(store: Path) -> None:
    for experiment in ("trials", "later"):
        connect(None, experiment)
        with training_run("id-1", "d", {}, {}, "data/render", store):
            pass
    (run,) = mlflow.search_runs(search_all_experiments=True, output_format="list")
    assert mlflow.get_experiment(run.info.experiment_id).name == "trials"


def test_a_failed_evaluation_leaves_a_training_finished(store: Path) -> None:
    with training_run("id-1", "d", {}, {}, "data/render", store):
        pass
    (before,) = mlflow.search_runs(output_format="list")
    with pytest.raises(FileNotFoundError):
        log_results("id-1", "d", {}, {"figure": store / "missing.png"})
    (after,) = mlflow.search_runs(output_format="list")
    assert (after.info.status, after.info.end_time) == ("FINISHED", before.info.end_time)


def test_the_last_values_of_a_run_are_those_of_the_weights_that_it_keeps(store: Path) -> None:
    for keep_best in (True, False):
        parameters = {"training": {"keep_best": keep_best}}
        with training_run(f"{keep_best}", "d", parameters, {}, "data/render", store):
            for step, merit in enumerate((0.1, 0.7, 0.4)):
                metrics = {"validation/mAP": merit, "validation/tip_mm": abs(3.0 * step - 4.0)}
                mlflow.log_metrics(metrics, step=step)
    runs = mlflow.search_runs(output_format="list", order_by=["attributes.start_time ASC"])
    shown = [
        (run.data.metrics["validation/mAP"], run.data.metrics["validation/tip_mm"]) for run in runs
    ]
    assert shown == [(0.7, 1.0), (0.4, 2.0)]
