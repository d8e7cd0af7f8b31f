"""The summary of a sweep: its jobs' settings and metrics, and which is the best."""

import re
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path

from shaftpose.figures.style import save_figure
from shaftpose.figures.text import aligned
from shaftpose.metrics.best import best_of
from shaftpose.metrics.table import MetricValues, metrics_named
from shaftpose.sweeps.jobs import SweepJob, swept_parameters
from shaftpose.sweeps.page import Page, write_page
from shaftpose.sweeps.table import DRAWN, sweep_figures, write_table
from shaftpose.tracking.sweeps import SweepRun, add_summary, read_sweep, sweep_runs
from shaftpose.tracking.views import view_link

PHASE = "validation"
_SHORTER = re.compile(
    r"profiles\.\w+\.(steps|detector_steps|warmup_steps|validate_every)=|profiles\.smoke\."
    r"|profile=smoke$|training\.max_hours=|hydra"
)
SHOWN = metrics_named("mAP", "detected_rate", "tip_mm", "axis_deg")


def summarise(folder: Path, margin: float) -> None:
    """Print the finished jobs, write page, table and pictures to `folder`, and track them.

    margin: in mAP, within which the tip decides, see `best_of`. Prints nothing without a job.
    """
    runs = [run for run in sweep_runs(folder) if run.finished and run.metrics]
    sweep = read_sweep(folder)
    if not runs or sweep is None:
        return
    best = best_run(runs, margin)
    names, rows = table(runs, best)
    page = Page(
        sweep=folder.name,
        best=best.name,
        rule=f"lowest tip error where mAP is within {margin:g} of the highest",
        command=full_training(best),
        headings=[*names[1 : -len(SHOWN)], *(metric.heading for metric in SHOWN)],
        rows=[row[1:] for row in rows],
        link=view_link(sweep.experiment),
    )
    files = write_files(runs, folder, page)
    add_summary(sweep, runs, best, tuple(names[1 : -len(SHOWN)]), page.command, files)
    print(f"{aligned(names, rows)}\n")
    print(f"best: {page.rule}")
    print(f"at full length: {page.command}")
    print(f"page: {files[0]}")
    print(f"table and figures: {', '.join(map(str, files[1:]))}")
    print(f"MLflow: {page.link} (make ui)")


def best_run(runs: Sequence[SweepRun], margin: float) -> SweepRun:
    """The best of some runs by their validation metrics."""
    return {run.run_id: run for run in runs}[
        best_of({run.run_id: validation(run) for run in runs}, margin)
    ]


def validation(run: SweepRun) -> MetricValues:
    """The metrics of the validation of a run's result, without prefix."""
    return {name.removeprefix(f"{PHASE}/"): value for name, value in run.metrics.items()}


def table(runs: Sequence[SweepRun], best: SweepRun) -> tuple[list[str], list[list[str]]]:
    """Headings and cells: the best run is marked, the others follow by mAP."""
    swept = swept_parameters([SweepJob(run.parameters, {}) for run in runs])
    ordered = sorted(runs, key=lambda run: (run is not best, -run.metrics.get(DRAWN[0], 0.0)))
    rows = [
        [
            "best" if run is best else "",
            *(run.parameters.get(name, "") for name in swept),
            *_cells(validation(run)),
        ]
        for run in ordered
    ]
    return ["", *swept, *(metric.name for metric in SHOWN)], rows


def _cells(values: Mapping[str, float | int | None]) -> list[str]:
    known = ((values.get(metric.name), metric.digits) for metric in SHOWN)
    return ["n/a" if value is None else f"{value:.{digits}f}" for value, digits in known]


def full_training(best: SweepRun) -> str:
    """The command that repeats a run outside of the sweep, without what made it shorter: numbers of
    steps and a time limit of its own, and the profile `smoke`."""
    kept = [one for one in best.overrides if not _SHORTER.match(one)]
    return shlex.join(["python", "pipelines/train.py", *kept])


def write_files(runs: Sequence[SweepRun], folder: Path, page: Page) -> list[Path]:
    """Write page, table and figures of a sweep to its folder; returns their paths."""
    jobs = [SweepJob(run.parameters, run.metrics, run.steps) for run in runs]
    write_table(jobs, folder / "sweep.csv")
    figures = {folder / f"sweep_{name}.png": one for name, one in sweep_figures(jobs).items()}
    for path, figure in figures.items():
        save_figure(figure, path)
    write_page(page, list(figures), folder / "sweep.html")
    return [folder / "sweep.html", folder / "sweep.csv", *figures]
