"""Trainings of a sweep, nested in its run."""

from collections.abc import Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import mlflow
import pytest

from shaftpose.core.errors import InputError
from shaftpose.tracking.connection import connect
from shaftpose.tracking.sweeps import start_sweep, sweep_runs
from shaftpose.tracking.trainings import log_results, training_run


def training(
    name: str, parameters: Mapping[str, Any], folder: Path, *overrides: str
) -> AbstractContextManager[object]:
    return training_run(name, "d", parameters, {}, "data/render", folder, overrides)


def test_runs_of_a_sweep_are_nested(store: Path) -> None:
    folder = store / "sweeps" / "today"
    start_sweep(folder, "trials", {})
    for number in range(2):
        with training(f"id-{number}", {}, folder, f"seed={number}"):
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
        start_sweep(folder, "trials", {})
        with training(name, {}, folder, f"job={name}"):
            pass
    assert len(sweep_runs(folder)) == 2
    assert len(mlflow.search_runs(experiment_names=["trials"], output_format="list")) == 3


def test_a_sweep_gets_a_parent_run_where_the_database_lacks_it(store: Path) -> None:
    folder = store / "sweeps" / "today"
    start_sweep(folder, "trials", {})
    connect(f"sqlite:///{store / 'other.db'}", "trials")
    start_sweep(folder, "trials", {})
    with training("id-1", {}, folder):
        pass
    assert len(sweep_runs(folder)) == 1


def test_trainings_of_a_sweep_are_found_from_its_folder(store: Path) -> None:
    folder = store / "sweeps" / "today"
    start_sweep(folder, "trials", {})
    with training("elsewhere", {"seed": 1}, store):
        pass
    for number, alpha in enumerate((0.5, 1.5)):
        parameters = {"loss": {"alpha": alpha}}
        with training(f"id-{number}", parameters, folder, f"loss.alpha={alpha}"):
            mlflow.log_metrics({"validation/mAP": 0.9, "train/box": 2.0}, step=2)
            mlflow.log_metrics({"validation/mAP": alpha / 10}, step=3)
    runs = sweep_runs(folder)
    assert [run.parameters for run in runs] == [{"loss.alpha": "0.5"}, {"loss.alpha": "1.5"}]
    assert [run.metrics["validation/mAP"] for run in runs] == pytest.approx([0.05, 0.15])


def test_of_trainings_with_the_same_overrides_the_last_one_counts(store: Path) -> None:
    start_sweep(store, "trials", {})
    for number, value in enumerate((0.25, 0.5)):  # in between, the code was changed
        with training(f"id-{number}", {"alpha": 0.5}, store, "loss.alpha=0.5"):
            mlflow.log_metrics({"validation/mAP": value}, step=2)
    with training("id-2", {"alpha": 0.5}, store, "loss.alpha=0.5", "detection.nms_iou=0.6"):
        mlflow.log_metrics({"validation/mAP": 0.75}, step=2)
    found = [run.metrics for run in sweep_runs(store)]
    assert found == [{"validation/mAP": 0.5}, {"validation/mAP": 0.75}]


def test_metrics_of_a_training_are_all_of_its_last_validation(store: Path) -> None:
    start_sweep(store, "trials", {})
    with training("id-1", {}, store):
        mlflow.log_metrics({"validation/mAP": 0.5, "validation/tip_mm": 4.0}, step=2)
        mlflow.log_metrics({"validation/mAP": 0.0}, step=3)  # no correct detection any more
    log_results("id-1", "d", {"tip_mm": 3.0}, {})  # of the test images
    assert [run.metrics for run in sweep_runs(store)] == [{"validation/mAP": 0.0}]


def test_a_training_that_keeps_its_best_weights_is_rated_by_them(store: Path) -> None:
    start_sweep(store, "trials", {})
    for keep_best in (True, False):
        parameters, override = {"training": {"keep_best": keep_best}}, f"keep={keep_best}"
        with training(f"id-{keep_best}", parameters, store, override):
            for step, merit in enumerate((0.1, 0.7, 0.7, 0.4)):
                metrics = {"validation/mAP": merit, "validation/tip_mm": float(step)}
                mlflow.log_metrics(metrics, step=step)
    best, last = sweep_runs(store)
    assert (best.steps, best.metrics) == (2, {"validation/mAP": 0.7, "validation/tip_mm": 1.0})
    assert (last.steps, last.metrics) == (4, {"validation/mAP": 0.4, "validation/tip_mm": 3.0})


def test_only_a_training_that_came_to_its_end_is_finished(store: Path) -> None:
    start_sweep(store, "trials", {})
    with pytest.raises(RuntimeError), training("id-1", {}, store, "a=1"):
        raise RuntimeError
    with training("id-2", {}, store, "a=2"):
        assert [run.finished for run in sweep_runs(store)] == [False, False]
    assert [run.finished for run in sweep_runs(store)] == [False, True]


def test_results_of_a_sweeps_training_find_its_run_in_another_experiment(store: Path) -> None:
    connect(None, "trials grid")
    start_sweep(store, "trials grid", {})
    with training("id-1", {}, store):
        pass
    connect(None, "trials")
    log_results("id-1", "d", {"test": {"mAP": 0.5}}, {})
    runs = mlflow.search_runs(experiment_names=["trials grid"], output_format="list")
    assert [run.data.metrics.get("test/mAP") for run in runs].count(0.5) == 1
    assert mlflow.search_runs(experiment_names=["trials"], output_format="list") == []


def test_a_folder_without_a_sweep_is_named(store: Path) -> None:
    with pytest.raises(InputError, match=r"mlflow_sweep\.json: missing"):
        sweep_runs(store)
