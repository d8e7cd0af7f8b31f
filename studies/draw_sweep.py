"""Draw a Hydra sweep for docs/results.md.

`python -m studies.draw_sweep sweeps/TIME --name NAME` reads the sweep's finished trainings from
MLflow, draws them in `docs/images/sweep-NAME.png` and writes their table,
`reports/sweeps/NAME.csv`; `make results` puts both on the page.
"""

import argparse
import re
from collections.abc import Sequence
from pathlib import Path

import yaml
from matplotlib.figure import Figure

from shaftpose.core.errors import InputError, exit_on_input_error
from shaftpose.core.files import write_csv
from shaftpose.figures.style import save_figure
from shaftpose.sweeps.heat_maps import heat_map_figure, is_full_grid
from shaftpose.sweeps.jobs import SweepJob, swept_parameters
from shaftpose.sweeps.lines import line_figure
from shaftpose.tracking.connection import connect
from shaftpose.tracking.sweeps import sweep_runs

METRICS = ("validation/mAP", "validation/tip_mm", "validation/axis_deg")
# Further columns of the table, whether swept or not.
SCALE = (
    "loss.alpha", "loss.gamma", "loss.beta", "variant.name", "seed", "training_images",
    "size.batch_size", "size.width", "size.depth", "size.learning_rate",
)  # fmt: skip


def main() -> None:
    """Draw the sweep of the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("sweep", type=Path, help="the sweep's folder")
    parser.add_argument("--name", required=True, help="name of the picture and the table")
    arguments = parser.parse_args()
    with exit_on_input_error():
        picture, table = places(arguments.name)
        jobs, unfinished = read_jobs(arguments.sweep)
    save_figure(sweep_figure(jobs, METRICS), picture)
    write_table(jobs, table)
    print(f"{described(jobs, unfinished)}; see {picture} and {table}")


def places(name: str) -> tuple[Path, Path]:
    """The files of picture and table. Raises InputError if `name` is not valid in theirs."""
    if not re.fullmatch(r"[\w-]+", name):
        raise InputError(f"--name {name}: takes letters, digits, - and _ only")
    return Path(f"docs/images/sweep-{name}.png"), Path(f"reports/sweeps/{name}.csv")


def read_jobs(sweep: Path) -> tuple[list[SweepJob], int]:
    """The finished trainings of a sweep, and the number of unfinished ones.

    Raises InputError if there is nothing to compare.
    """
    connect(**yaml.safe_load(Path("params.yaml").read_text())["tracking"])
    runs = sweep_runs(sweep)
    jobs = [SweepJob(run.parameters, run.metrics, run.steps) for run in runs if run.finished]
    if not swept_parameters(jobs):
        raise InputError(
            f"{sweep}: {len(jobs)} of its {len(runs)} trainings are finished; a figure needs two "
            "that differ in a parameter: wait for the sweep to end, or run it again"
        )
    return jobs, len(runs) - len(jobs)


def described(jobs: Sequence[SweepJob], unfinished: int) -> str:
    """Sentence on the numbers of trainings drawn, without metrics, and left out."""
    lacking = sum(not job.metrics.keys() >= set(METRICS) for job in jobs)
    return (
        f"{len(jobs)} finished trainings are drawn, {lacking} of them without a correct "
        f"detection and thus without errors; {unfinished} others are not finished"
    )


def sweep_figure(jobs: Sequence[SweepJob], metrics: Sequence[str]) -> Figure:
    """Heat maps of a full grid of two settings, parallel coordinates of any other sweep."""
    draw = heat_map_figure if is_full_grid(jobs) else line_figure
    return draw(jobs, metrics)


def write_table(jobs: Sequence[SweepJob], path: Path) -> None:
    """Write one line for each job; missing values are empty."""
    names = list(dict.fromkeys([*swept_parameters(jobs), *SCALE]))
    rows = []
    for job in jobs:
        row = [*(job.parameters.get(name, "") for name in names), job.steps]
        values = [job.metrics.get(name) for name in METRICS]
        rows.append([*row, *("" if value is None else f"{value:.6g}" for value in values)])
    write_csv(path, [*names, "steps", *METRICS], rows)


if __name__ == "__main__":
    main()
