"""Runs of one MLflow database in another one."""

from pathlib import Path

import mlflow
import pytest
from mlflow import MlflowClient
from mlflow.entities import Metric

from shaftpose.tracking.sweeps import start_sweep
from shaftpose.tracking.trainings import training_run
from tools.copy_runs import copy_runs, every_run, main


@pytest.fixture
def source(store: Path) -> str:
    """A database with a sweep of one training."""
    start_sweep(store, "trials", {"loss.alpha": "1,2"})
    parameters = {f"p{n}": n for n in range(150)} | {"loss": {"alpha": 2}}
    with training_run("id-1", "d", parameters, {"data/render": "aa"}, "data/render", store):
        points = [Metric("train/loss", 3.0 - step, 0, step) for step in range(1200)]
        for some in (points[:600], points[600:]):
            MlflowClient().log_batch(mlflow.active_run().info.run_id, some)
        mlflow.log_text("a page", "figures/page.html")
    return str(mlflow.get_tracking_uri())


def test_a_run_is_copied_whole_and_once(source: str, tmp_path: Path) -> None:
    target = f"sqlite:///{tmp_path / 'other.db'}"
    assert copy_runs(source, target) == 2
    assert copy_runs(source, target) == 0
    client = MlflowClient(target)
    runs = {run.info.run_name: run for run in every_run(client)}
    (original,) = [run for run in every_run(MlflowClient(source)) if run.info.run_name == "d"]
    copied, parent = runs["d"], runs[f"sweep {tmp_path.name}"]
    assert copied.data.params == original.data.params
    assert copied.data.metrics == original.data.metrics
    assert (copied.info.start_time, copied.info.end_time, copied.info.status) == (
        original.info.start_time, original.info.end_time, "FINISHED",
    )  # fmt: skip
    assert copied.data.tags["shaftpose.training"] == "id-1"
    assert copied.data.tags["mlflow.parentRunId"] == parent.info.run_id
    assert copied.inputs.dataset_inputs[0].dataset.digest == "aa"
    history = client.get_metric_history(copied.info.run_id, "train/loss")
    assert [point.step for point in history] == list(range(1200))
    assert client.get_experiment(copied.info.experiment_id).name == "trials"
    page = client.download_artifacts(copied.info.run_id, "figures/page.html", str(tmp_path))
    assert Path(page).read_text() == "a page"


def test_an_interrupted_copy_goes_on(
    source: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = f"sqlite:///{tmp_path / 'other.db'}"
    with monkeypatch.context() as patch:
        patch.setattr(MlflowClient, "log_artifacts", interrupted)
        with pytest.raises(KeyboardInterrupt):
            copy_runs(source, target)
    assert copy_runs(source, target) == 1  # the sweep's own run was copied
    runs = {run.info.run_name: run for run in every_run(MlflowClient(target))}
    assert len(runs) == len(every_run(MlflowClient(target))) == 2
    assert runs["d"].info.status == "FINISHED"
    assert MlflowClient(target).list_artifacts(runs["d"].info.run_id)


def interrupted(*arguments: object) -> None:
    raise KeyboardInterrupt


def test_what_is_missing_is_named(store: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.argv", ["copy_runs", "http://127.0.0.1:1"])
    with pytest.raises(SystemExit, match=r"MLflow at http://127\.0\.0\.1:1: no answer"):
        main()
    (store / "mlflow.db").unlink()
    with pytest.raises(SystemExit, match=r"mlflow\.db: missing; run this where the runs were made"):
        main()
