"""A sweep: an MLflow experiment of its own, where the runs of its trainings have one parent."""

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

import mlflow
from mlflow.entities import Run, RunStatus

from shaftpose.core.errors import InputError
from shaftpose.core.files import write_json
from shaftpose.stage_files import read_stage_file
from shaftpose.tracking.validations import validation_of_result
from shaftpose.tracking.views import results, view_tag

_RECORD = "mlflow_sweep.json"
OVERRIDES_TAG = "shaftpose.overrides"


@dataclass(frozen=True)
class Sweep:
    """A sweep's record in its folder.

    run_id: of the parent run; experiment: its name; swept: the keys that have several values.
    """

    run_id: str
    experiment: str
    swept: tuple[str, ...]


def start_sweep(folder: Path, experiment: str, overrides: Mapping[str, str]) -> None:
    """Create the parent run of a sweep, and record the sweep in its folder.

    experiment: the present one, see `connect`. overrides: the swept keys with their values. Call it
    before the jobs start. A resumed sweep keeps its parent run if the database holds it.
    """
    known = read_sweep(folder)
    if known is not None and _is_in_database(known.run_id):
        return
    with mlflow.start_run(run_name=f"sweep {folder.name}") as run:
        mlflow.set_tag("shaftpose.sweep", str(folder))
        mlflow.log_params(overrides)
    folder.mkdir(parents=True, exist_ok=True)
    write_json(folder / _RECORD, asdict(Sweep(run.info.run_id, experiment, tuple(overrides))))


class SweepRun(NamedTuple):
    """A training of a sweep.

    run_id, name: MLflow's. overrides: of its command line. steps: up to the validation of the
    weights that are its result. metrics: of that validation, such as `validation/mAP`.
    """

    run_id: str
    name: str
    finished: bool
    overrides: Sequence[str]
    parameters: dict[str, str]
    steps: int
    metrics: dict[str, float]


def sweep_runs(folder: Path) -> list[SweepRun]:
    """The trainings of a sweep, including unfinished ones, in the order of their first start.

    Of trainings with equal overrides only the last is returned: a sweep that is run again trains
    its jobs again if code, data or other settings have changed. Raises InputError if no sweep was
    tracked from `folder`.
    """
    sweep = read_sweep(folder)
    if sweep is None:
        raise InputError(f"{folder / _RECORD}: missing; name the folder of a Hydra sweep")
    found: list[Run] = mlflow.search_runs(
        experiment_names=[sweep.experiment],
        filter_string=f"tags.`mlflow.parentRunId` = '{sweep.run_id}'",
        order_by=["attributes.start_time ASC"],
        output_format="list",
    )
    latest = {run.data.tags.get(OVERRIDES_TAG): run for run in found}
    return [_sweep_run(run) for run in latest.values()]


def _sweep_run(run: Run) -> SweepRun:
    return SweepRun(
        run.info.run_id,
        run.info.run_name,
        run.info.status == RunStatus.to_string(RunStatus.FINISHED),
        shlex.split(run.data.tags.get(OVERRIDES_TAG, "")),
        run.data.params,
        *validation_of_result(run),
    )


def add_summary(
    sweep: Sweep,
    runs: Sequence[SweepRun],
    best: SweepRun,
    parameters: Sequence[str],
    command: str,
    files: Sequence[Path],
) -> None:
    """Add a summary to the parent run, and save the view in which MLflow's page shows the sweep.

    parameters: those that differ; command: trains the best run at full length.
    """
    client = mlflow.MlflowClient()
    for run in runs:
        client.set_tag(run.run_id, "best", "best" if run is best else "")
    client.set_tag(sweep.run_id, "best", best.name)
    client.set_tag(sweep.run_id, "mlflow.note.content", f"Best: {best.name}\n\n`{command}`")
    for path in files:
        client.log_artifact(sweep.run_id, str(path))
    columns = ["tags.`best`", *results("validation"), *(f"params.`{p}`" for p in parameters)]
    experiment = client.get_run(sweep.run_id).info.experiment_id
    for key, value in view_tag(columns, expanded=sweep.run_id).items():
        client.set_experiment_tag(experiment, key, value)


def read_sweep(folder: Path) -> Sweep | None:
    """The sweep that `start_sweep` recorded in a folder, None if it did not."""
    path = folder / _RECORD
    return read_stage_file(path, Sweep, "name another folder") if path.is_file() else None


def _is_in_database(run_id: str) -> bool:
    found: list[Run] = mlflow.search_runs(
        filter_string=f"attributes.run_id = '{run_id}'", output_format="list"
    )
    return bool(found)
