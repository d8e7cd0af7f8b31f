"""Names and parents of runs."""

from pathlib import Path

import mlflow
import pytest

from shaftpose.tracking.parents import log_report, repro_run, run_name
from shaftpose.tracking.trainings import training_run


def test_a_run_is_named_by_what_differs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DVC_EXP_NAME", raising=False)
    given = ["variant=d", "loss.alpha=0.5", "loss.gamma=2", "profiles.demo.steps=500"]
    assert run_name("d", given, ["loss.alpha", "loss.gamma", "variant"]) == "d  alpha=0.5 gamma=2"
    assert run_name("d", given, []) == "d"
    assert run_name("d", [*given, "out=x"], None) == "d  alpha=0.5 gamma=2 steps=500"
    assert run_name("d", ["+loss.beta=[1,1,2,2,2]"], ["loss.beta"]) == "d  beta=[1,1,2,2,2]"
    monkeypatch.setenv("DVC_EXP_NAME", "vexed-tank")
    assert run_name("d", ["out=models/d"], []) == "d  vexed-tank"


def test_runs_of_one_dvc_repro_have_one_parent(
    store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DVC_EXP_NAME", raising=False)
    monkeypatch.delenv("DVC_STAGE", raising=False)
    assert repro_run() is None
    monkeypatch.setenv("DVC_STAGE", "train@d")
    (store / "params.yaml").write_text("seed: 7\n")
    page = store / "ablation.html"
    page.write_text("<html></html>")
    for name in ("c", "d"):
        with training_run(f"id-{name}", name, {}, {}, "data/render", store):
            pass
    log_report(page)
    (store / "params.yaml").write_text("seed: 8\n")
    other = repro_run()
    runs = {run.info.run_name: run for run in mlflow.search_runs(output_format="list")}
    (parent,) = {runs[name].data.tags["mlflow.parentRunId"] for name in ("c", "d")}
    assert parent != other
    files = {one.path for one in mlflow.MlflowClient().list_artifacts(parent)}
    assert files == {"params.yaml", "ablation.html"}


def test_a_dvc_experiment_keeps_its_name(store: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DVC_STAGE", "train@d")
    monkeypatch.setenv("DVC_EXP_NAME", "vexed-tank")
    (store / "params.yaml").touch()
    run = repro_run()
    assert mlflow.get_run(run).info.run_name == "vexed-tank"
    assert repro_run() == run
