"""The summary of a sweep, in the console, its folder and MLflow."""

import re
from pathlib import Path

import mlflow
import pytest

from shaftpose.sweeps.summary import summarise
from shaftpose.sweeps.table import read_table
from shaftpose.tracking.sweeps import start_sweep
from shaftpose.tracking.trainings import training_run

SHORTER = "profiles.demo.steps=9", "profiles.smoke.batch_size=2", "training.max_hours=1"
RATE = "profiles.demo.learning_rate=0.002"
MEASURED = {  # alpha, gamma -> mAP, tip
    (0.5, 1): (0.96, 8.0), (0.5, 5): (0.95, 6.0), (1.5, 1): (0.5, 2.0), (1.5, 5): (0.97, None),
}  # fmt: skip


@pytest.fixture
def sweep(store: Path) -> Path:
    """The folder of a finished sweep of alpha and gamma."""
    folder = store / "sweeps/grid"
    start_sweep(folder, "trials", {"loss.alpha": "0.5,1.5", "loss.gamma": "1,5"})
    for n, ((alpha, gamma), (mAP, tip)) in enumerate(MEASURED.items()):
        given = [
            "variant=d",
            f"loss.alpha={alpha}",
            f"loss.gamma={gamma}",
            "profile=smoke",
            RATE,
            *SHORTER,
        ]
        parameters = {"loss": {"alpha": alpha, "gamma": gamma}, "variant": {"name": "d"}}
        known = {"validation/mAP": mAP} | ({"validation/tip_mm": tip} if tip else {})
        with training_run(f"id-{n}", "d", parameters, {}, "data/render", folder, given):
            mlflow.log_metrics(known, step=8)
    return folder


def test_a_sweep_ends_with_a_table_and_the_best_job(
    sweep: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    summarise(sweep, margin=0.02)
    printed = capsys.readouterr().out.splitlines()
    assert [line.split() for line in printed[:5]] == [
        ["loss.alpha", "loss.gamma", "mAP", "detected_rate", "tip_mm", "axis_deg"],
        ["best", "0.5", "5", "0.950", "n/a", "6.00", "n/a"],
        ["1.5", "5", "0.970", "n/a", "n/a", "n/a"],
        ["0.5", "1", "0.960", "n/a", "8.00", "n/a"],
        ["1.5", "1", "0.500", "n/a", "2.00", "n/a"],
    ]
    command = f"python pipelines/train.py variant=d loss.alpha=0.5 loss.gamma=5 {RATE}"
    assert f"at full length: {command}" in printed
    assert any(line.startswith("MLflow: http://127.0.0.1:5000/#/experiments/") for line in printed)
    for name in ("sweep_lines.png", "sweep_maps.png"):
        assert (sweep / name).read_bytes().startswith(b"\x89PNG")
    assert len(read_table(sweep / "sweep.csv")) == 4


def test_the_parent_run_holds_the_sweeps_summary(sweep: Path) -> None:
    summarise(sweep, margin=0.02)
    runs = {run.info.run_name: run for run in mlflow.search_runs(output_format="list")}
    parent, best = runs["sweep grid"], runs["d  alpha=0.5 gamma=5"]
    assert parent.data.params == {"loss.alpha": "0.5,1.5", "loss.gamma": "1,5"}
    assert parent.data.tags["best"] == best.info.run_name
    assert best.data.tags["best"] == "best"
    assert "loss.alpha=0.5 loss.gamma=5" in parent.data.tags["mlflow.note.content"]
    files = {one.path for one in mlflow.MlflowClient().list_artifacts(parent.info.run_id)}
    assert files == {"sweep.html", "sweep.csv", "sweep_lines.png", "sweep_maps.png"}


def test_a_sweeps_page_shows_the_best_job_first(sweep: Path) -> None:
    summarise(sweep, margin=0.02)
    page = (sweep / "sweep.html").read_text()
    assert '<div class="best">d  alpha=0.5 gamma=5</div>' in page
    rows = re.findall("<tr>(.*)</tr>", page)
    assert [re.findall("<td>(.*?)</td>", row) for row in rows[1:3]] == [
        ["0.5", "5", "0.950", "n/a", "6.00", "n/a"], ["1.5", "5", "0.970", "n/a", "n/a", "n/a"],
    ]  # fmt: skip
    assert page.count("data:image/png;base64,") == 2


def test_a_sweep_without_finished_jobs_has_no_summary(
    store: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    start_sweep(store / "sweeps/none", "trials", {})
    summarise(store / "sweeps/none", margin=0.02)
    assert capsys.readouterr().out == ""
