"""Draw a sweep of Hydra as one figure: `python tools/sweep_figure.py sweeps/TIME --out FILE.png`.

The trainings are those of the sweep's MLflow run. A table of the same, FILE.csv, is written beside
the figure.
"""

import argparse
import csv
import sys
from collections.abc import Sequence
from pathlib import Path

import yaml

from shaftpose import tracking
from shaftpose.errors import InputError
from shaftpose.evaluation.figure_style import save_figure
from shaftpose.evaluation.sweep_figure import SweepJob, sweep_figure, swept_parameters

METRICS = ("validation/mAP", "validation/tip_mm", "validation/axis_deg")


def main() -> None:
    """Draw the sweep of the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("sweep", type=Path, help="the sweep's folder")
    parser.add_argument("--out", type=Path, required=True, help="the PNG file to write")
    arguments = parser.parse_args()
    try:
        jobs = read_jobs(arguments.sweep)
    except InputError as error:
        sys.exit(f"error: {error}")
    save_figure(sweep_figure(jobs, METRICS), arguments.out)
    write_table(jobs, arguments.out.with_suffix(".csv"))
    print(f"{len(jobs)} trainings are drawn in {arguments.out}")


def read_jobs(sweep: Path) -> list[SweepJob]:
    """The finished trainings of a sweep, those without a right detection left out."""
    tracking.connect(**yaml.safe_load(Path("params.yaml").read_text())["tracking"])
    jobs = [SweepJob(run.parameters, run.metrics) for run in tracking.sweep_runs(sweep)]
    complete = [job for job in jobs if job.metrics.keys() >= set(METRICS)]
    if len(complete) < 2 or not swept_parameters(complete):
        raise InputError(
            f"{sweep}: {len(complete)} of its {len(jobs)} trainings have {', '.join(METRICS)}; a "
            "figure needs two that differ: wait for the sweep to end, or train for more steps"
        )
    return complete


def write_table(jobs: Sequence[SweepJob], path: Path) -> None:
    """One line for each job."""
    names = swept_parameters(jobs)
    with path.open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow([*names, *METRICS])
        for job in jobs:
            row = [job.parameters[name] for name in names]
            table.writerow([*row, *(f"{job.metrics[name]:.6g}" for name in METRICS)])


if __name__ == "__main__":
    main()
