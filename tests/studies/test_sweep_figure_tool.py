"""The tool that draws a sweep, with MLflow runs in a separate database."""

import sys
from pathlib import Path

import mlflow
import pytest

from shaftpose.core.errors import InputError
from shaftpose.tracking.sweeps import start_sweep
from shaftpose.tracking.trainings import training_run
from studies import draw_sweep as sweep_figure
from studies import write_results_page as results_page

ROOT = Path(__file__).parents[2]

FOUND = {"validation/mAP": 0.5, "validation/tip_mm": 4.25, "validation/axis_deg": 9.0}
NOTHING_RIGHT = {"validation/mAP": 0.0}


@pytest.fixture
def sweep(store: Path) -> Path:
    """The folder of a sweep without trainings."""
    (store / "params.yaml").write_text("tracking: {uri: null, experiment: trials}\n")
    start_sweep(store / "sweeps/today", "sweep")
    return store / "sweeps/today"


def train(sweep: Path, parameters: dict[str, str], metrics: dict[str, float]) -> None:
    """A job of the sweep that ends with these metrics."""
    with training_run(parameters["variant.name"], "d", parameters, {}, "", sweep):
        mlflow.log_metrics(metrics, step=5)


def test_finished_trainings_are_drawn_and_others_counted(
    sweep: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, more, metrics in (
        ("b", {"variant.steps": "[1, 5]"}, FOUND),
        ("d", {}, NOTHING_RIGHT),
    ):
        scale = {"loss.alpha": "1.5", "size.width": "0.25", "size.depth": "0.5"}
        train(sweep, {"variant.name": name, **scale, **more}, metrics)
    with pytest.raises(RuntimeError), training_run("dies", "c", {}, {}, "", sweep):
        mlflow.log_metrics(FOUND, step=2)
        raise RuntimeError
    monkeypatch.setattr(sys, "argv", ["sweep_figure.py", str(sweep), "--name", "heads"])
    sweep_figure.main()
    assert "2 finished trainings are drawn, 1 of them without" in capsys.readouterr().out
    headings, *jobs = results_page.sweeps(Path())["heads"]
    # Swept parameters come first; both jobs were validated after step 6.
    assert headings == [
        "variant.name", "loss.alpha", "loss.gamma", "loss.beta", "seed", "training_images",
        "size.batch_size", "size.width", "size.depth", "size.learning_rate", "steps",
        "validation/mAP", "validation/tip_mm", "validation/axis_deg",
    ]  # fmt: skip
    assert jobs == [
        ["b", "1.5", "", "", "", "", "", "0.25", "0.5", "", "6", "0.5", "4.25", "9"],
        ["d", "1.5", "", "", "", "", "", "0.25", "0.5", "", "6", "0", "", ""],
    ]
    assert Path("docs/images/sweep-heads.png").read_bytes().startswith(b"\x89PNG")


def test_a_sweep_with_nothing_to_compare_is_refused(sweep: Path) -> None:
    train(sweep, {"variant.name": "b"}, FOUND)
    with pytest.raises(InputError, match="1 of its 1 trainings are finished"):
        sweep_figure.read_jobs(sweep)


def test_a_name_that_leads_elsewhere_is_refused() -> None:
    with pytest.raises(InputError, match=r"--name \.\./d: takes letters"):
        sweep_figure.places("../d")
