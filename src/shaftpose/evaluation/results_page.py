"""The page of results: the recorded run, repeated trainings, sweeps, benchmarks, all from files."""

from collections.abc import Mapping, Sequence
from typing import Any

from shaftpose.evaluation.ablation import AblationReport
from shaftpose.evaluation.binned_errors_figure import FEWEST
from shaftpose.evaluation.repeated_trainings import repeated_blocks
from shaftpose.evaluation.report import blocks, pipe_table
from shaftpose.evaluation.sweep_jobs import NO_VALUE
from shaftpose.evaluation.training_record import TrainingRecord
from shaftpose.nested import flatten

Table = list[list[str]]  # the headings, then the cells line by line

INTRO = (
    "Written by `make results` from `reports/ablation.json`, `reports/trainings/*.json`, "
    "`reports/sweeps/*.csv`, `benchmarks/results/*.json` and, for what classes cost, "
    "`conf/variant/*.yaml` with the ranges of `params.yaml`; not to be edited."
)
ROUNDING = (
    "Mean errors of a network that finds the right class of every dimension of every pose; what a "
    "trained B has beyond them it has not learned. They follow from the classes alone."
)
RUN = (
    "Tables I and II and the errors below them are of one run of `make repro` at the profile "
    "`{profile}`."
)
BINNED = (
    "Median errors by depth, pitch, yaw around its seam and visible fraction, "
    f"where at least {FEWEST} instruments were found; `make figures` takes the picture over from "
    "the recorded run.\n\n"
    "![Binned errors](images/binned_errors.png)"
)
SWEEPS = (
    "Trainings that differ in their settings, by metrics of the last validation. The lighter a "
    "line, the better its mAP; the lighter a cell, the better its value. "
    f"`{NO_VALUE}`: a variant does not have the setting, or nothing was found right, so that there "
    "is no error to measure."
)
SPEED = "What is aimed at in rendering, and what of it is reached, is in [scaling.md](scaling.md)."


def to_page(
    report: AblationReport,
    records: Sequence[TrainingRecord],
    rounding: str,
    sweeps: Mapping[str, Table],
    benchmarks: Mapping[str, Any],
) -> str:
    """The page as Markdown.

    report: the recorded run; records: trainings that may be repeats of each other; rounding: the
    table of what pose classes cost; sweeps: tables that `tools/sweep_figure.py` wrote and
    benchmarks: the contents of result files, by name.
    """
    parts = ["# Results", INTRO]
    if records:
        parts += ["## Table I: repeated trainings", *repeated_blocks(records)]
        parts += ["### What classes cost at best", ROUNDING, rounding]
    parts += ["## The pipeline's run", RUN.format(profile=report.profile)]
    parts += [*blocks(report, "###"), "### Where the errors are", BINNED]
    if sweeps:
        parts += ["## Sweeps", SWEEPS, *_sweeps(sweeps)]
    if benchmarks:
        parts += ["## Speed", SPEED, *_speed(benchmarks)]
    return "\n\n".join(parts) + "\n"


def _sweeps(sweeps: Mapping[str, Table]) -> list[str]:
    """For each sweep its picture and its table."""
    parts = []
    for name, (headings, *jobs) in sweeps.items():
        cells = [[cell or NO_VALUE for cell in job] for job in jobs]
        picture = f"![Settings and metrics](images/sweep-{name}.png)"
        parts += [f"### {name}", picture, pipe_table(headings, cells)]
    return parts


def _speed(benchmarks: Mapping[str, Any]) -> list[str]:
    """For each benchmark its single values, then its lists as tables; `parts`, the details that its
    values come from, stay in its file."""
    parts = []
    for name, content in benchmarks.items():
        shown = flatten({key: value for key, value in content.items() if key != "parts"})
        single = [[key, _text(value)] for key, value in shown.items() if not _is_table(value)]
        parts += [f"### {name}", pipe_table(["key", "value"], single)]
        for key, rows in shown.items():
            if _is_table(rows):
                cells = [[_text(value) for value in row.values()] for row in rows]
                parts += [f"{key}:", pipe_table(list(rows[0]), cells)]
    return parts


def _is_table(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and isinstance(value[0], Mapping)


def _text(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
