"""A sweep: one MLflow run with the runs of its trainings nested in it."""

from pathlib import Path
from typing import NamedTuple

import mlflow
from mlflow.entities import Run, RunStatus

from shaftpose.core.errors import InputError

_PARENT_FILE = "mlflow_parent.txt"


def start_sweep(folder: Path, name: str) -> None:
    """Create the parent run of a sweep and record it in the sweep's folder.

    Call it before the jobs start. A resumed sweep keeps its parent run if the database holds it.
    """
    known = read_parent(folder)
    if known is not None and _is_in_database(known):
        return
    with mlflow.start_run(run_name=name) as run:
        mlflow.set_tag("shaftpose.sweep", str(folder))
    folder.mkdir(parents=True, exist_ok=True)
    (folder / _PARENT_FILE).write_text(run.info.run_id)


class SweepRun(NamedTuple):
    """A training of a sweep.

    run_id: MLflow's. steps: up to the last validation. metrics: of that validation, such as
    `validation/mAP`.
    """

    run_id: str
    finished: bool
    parameters: dict[str, str]
    steps: int
    metrics: dict[str, float]


def sweep_runs(folder: Path) -> list[SweepRun]:
    """The trainings of a sweep, including unfinished ones, in the order of their first start.

    Of trainings with equal parameters only the last is returned: a sweep that is run again trains
    its jobs again if code or data have changed. Raises InputError if no sweep was tracked from
    `folder`.
    """
    parent = read_parent(folder)
    if parent is None:
        raise InputError(f"{folder / _PARENT_FILE}: missing; name the folder of a Hydra sweep")
    found: list[Run] = mlflow.search_runs(
        filter_string=f"tags.`mlflow.parentRunId` = '{parent}'",
        order_by=["attributes.start_time ASC"],
        output_format="list",
    )
    finished = RunStatus.to_string(RunStatus.FINISHED)
    latest = {frozenset(run.data.params.items()): run for run in found}
    return [
        SweepRun(run.info.run_id, run.info.status == finished, run.data.params, *_validation(run))
        for run in latest.values()
    ]


def _validation(run: Run) -> tuple[int, dict[str, float]]:
    """The steps of a run up to its last validation, and the metrics of that validation.

    A metric's own last value may be older: pose errors are missing if nothing was found.
    """
    client = mlflow.MlflowClient()
    names = [name for name in run.data.metrics if name.startswith("validation/")]
    logged = [point for n in names for point in client.get_metric_history(run.info.run_id, n)]
    last = max((point.step for point in logged), default=-1)  # counted from 0
    return last + 1, {point.key: point.value for point in logged if point.step == last}


def read_parent(folder: Path) -> str | None:
    """The id of the run that `start_sweep` recorded in a folder, None if it did not."""
    note = folder / _PARENT_FILE
    return note.read_text() if note.is_file() else None


def _is_in_database(run_id: str) -> bool:
    found: list[Run] = mlflow.search_runs(
        filter_string=f"attributes.run_id = '{run_id}'", output_format="list"
    )
    return bool(found)
