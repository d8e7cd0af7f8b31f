"""The tool that draws a sweep, with MLflow runs in a separate database."""

import sys
from pathlib import Path

import mlflow
import pytest

from shaftpose.core.errors import InputError
from shaftpose.sweeps.jobs import SweepJob
from shaftpose.tracking.sweeps import start_sweep
from shaftpose.tracking.trainings import training_run
from studies import draw_sweep
from studies import write_results_page as results_page

ROOT = Path(__file__).parents[2]

FOUND = {"validation/mAP": 0.5, "validation/tip_mm": 4.25, "validation/axis_deg": 9.0}
NOTHING_RIGHT = {"validation/mAP": 0.0}


@pytest.fixture
def sweep(store: Path) -> Path:
    """The folder of a sweep without trainings."""
    (store / "params.yaml").write_text("tracking: {uri: null, experiment: trials}\n")
    start_sweep(store / "sweeps/today", "trials", {})
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
    monkeypatch.setattr(sys, "argv", ["draw_sweep.py", str(sweep), "--name", "heads"])
    draw_sweep.main()
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
        draw_sweep.read_jobs(sweep)


def test_a_name_that_leads_elsewhere_is_refused() -> None:
    with pytest.raises(InputError, match=r"--name \.\./d: takes letters"):
        draw_sweep.places("../d")


METRICS = ["mAP", "tip_mm"]


def jobs_of(*settings: tuple[str, ...]) -> list[SweepJob]:
    """Jobs with these values of the settings a, b and c; all have the same d."""
    return [
        SweepJob(dict(zip("abc", values, strict=False)) | {"d": "7"}, {"mAP": 0.1 * n, "tip_mm": n})
        for n, values in enumerate(settings)
    ]


GRID = [("1", "x"), ("1", "y"), ("2", "x"), ("2", "y")]


def panels(jobs: list[SweepJob]) -> list[str]:
    """The titles of a figure's panels; parallel coordinates have one untitled panel."""
    return [
        axes.get_title().partition("\n")[0] for axes in draw_sweep.sweep_figure(jobs, METRICS).axes
    ]


def test_a_full_grid_of_two_settings_is_a_heat_map_for_each_metric() -> None:
    assert panels(jobs_of(*GRID)) == METRICS


@pytest.mark.parametrize(
    "settings",
    [
        GRID[:3],  # a job is missing
        [*GRID, GRID[0]],  # a pair has two jobs
        [("1", "x"), ("2", "x")],
        [("1", "x"), ("2", "y")],
        [(*pair, c) for pair in GRID for c in "34"],
    ],
)
def test_any_other_sweep_is_parallel_coordinates(settings: list[tuple[str, ...]]) -> None:
    assert panels(jobs_of(*settings)) == [""]
