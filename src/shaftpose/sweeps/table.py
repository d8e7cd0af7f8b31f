"""The table of a sweep's jobs, as a CSV file, and its figures."""

import csv
from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure

from shaftpose.core.files import write_csv
from shaftpose.sweeps.heat_maps import heat_map_figure, is_full_grid
from shaftpose.sweeps.jobs import SweepJob, swept_parameters
from shaftpose.sweeps.lines import line_figure

DRAWN = ("validation/mAP", "validation/tip_mm", "validation/axis_deg")
# Further columns, whether swept or not.
SCALE = (
    "loss.alpha", "loss.gamma", "variant.name", "seed", "training_images",
    "size.batch_size", "size.width", "size.depth", "size.learning_rate",
)  # fmt: skip
STEPS = "steps"  # the column between parameters and metrics


def write_table(jobs: Sequence[SweepJob], path: Path) -> None:
    """Write one line for each job; missing values are empty."""
    names = list(dict.fromkeys([*swept_parameters(jobs), *SCALE]))
    rows = []
    for job in jobs:
        row = [*(job.parameters.get(name, "") for name in names), job.steps]
        values = [job.metrics.get(name) for name in DRAWN]
        rows.append([*row, *("" if value is None else f"{value:.6g}" for value in values)])
    write_csv(path, [*names, STEPS, *DRAWN], rows)


def read_table(path: Path) -> list[SweepJob]:
    """The jobs of a table that `write_table` wrote."""
    with path.open(newline="", encoding="utf-8") as stream:
        return [_job(row) for row in csv.DictReader(stream)]


def _job(row: dict[str, str]) -> SweepJob:
    names = list(row)
    split = names.index(STEPS)
    parameters = {name: row[name] for name in names[:split] if row[name]}
    metrics = {name: float(row[name]) for name in names[split + 1 :] if row[name]}
    return SweepJob(parameters, metrics, int(row[STEPS]))


def sweep_figures(jobs: Sequence[SweepJob]) -> dict[str, Figure]:
    """Parallel coordinates and, of a full grid of two settings, heat maps, by name."""
    figures: dict[str, Figure] = {}
    if is_full_grid(jobs):
        figures["maps"] = heat_map_figure(jobs, DRAWN)
    if swept_parameters(jobs):
        figures["lines"] = line_figure(jobs, DRAWN)
    return figures
