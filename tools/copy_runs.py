"""Copy the runs of `mlflow.db` to an MLflow server, which did not answer when they were made.

`python -m tools.copy_runs http://SERVER:5000` copies parameters, metrics, tags and files of all
runs that the server lacks. It copies no models: `dvc repro -s -f export` logs them there again.
After an interruption, the same command goes on: it removes the half of a run, and copies it again.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from mlflow import MlflowClient
from mlflow.entities import Metric, Param, Run

from shaftpose.core.errors import InputError, exit_on_input_error
from shaftpose.tracking.connection import select_store, workspace

_COPYING, _COPIED = "shaftpose.copying_from", "shaftpose.copied_from"  # at the start; at the end
_PARENT = "mlflow.parentRunId"
_MOST_METRICS, _MOST_PARAMS = 1000, 100  # in one call, MLflow's limits


def main() -> None:
    """Copy the runs of this folder to the server of the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("server", help="its address, http://SERVER:5000")
    target = parser.parse_args().server
    root = workspace(Path.cwd())
    database = root / "mlflow.db"
    with exit_on_input_error():
        if not database.is_file():
            raise InputError(f"{database}: missing; run this where the runs were made")
        select_store(target, root)
        print(f"runs copied: {copy_runs(f'sqlite:///{database}', target)}")


def copy_runs(source: str, target: str) -> int:
    """Copy the runs that a tracking server or database lacks to it; returns their number."""
    old, new = MlflowClient(source), MlflowClient(target)
    names = {one.experiment_id: one.name for one in old.search_experiments()}
    known = {}
    for run in every_run(new):
        if _COPIED in run.data.tags:
            known[run.data.tags[_COPIED]] = run.info.run_id
        elif _COPYING in run.data.tags:
            new.delete_run(run.info.run_id)
    before = len(known)
    for run in sorted(every_run(old), key=lambda run: run.info.start_time):  # parents first
        if run.info.run_id not in known:
            experiment = _experiment(new, names[run.info.experiment_id], old)
            known[run.info.run_id] = _copy(run, old, new, experiment, known)
    return len(known) - before


def every_run(client: MlflowClient) -> list[Run]:
    """All runs of a database, but for deleted ones."""
    experiments = [one.experiment_id for one in client.search_experiments()]
    found, token = [], None
    while True:
        page = client.search_runs(experiments, page_token=token)
        found += page
        if not (token := page.token):
            return found


def _experiment(new: MlflowClient, name: str, old: MlflowClient) -> str:
    found = new.get_experiment_by_name(name)
    if found is not None:
        return str(found.experiment_id)
    return str(new.create_experiment(name, tags=old.get_experiment_by_name(name).tags))


def _copy(
    run: Run, old: MlflowClient, new: MlflowClient, experiment: str, known: dict[str, str]
) -> str:
    """Copy one run, whose parent is known; returns the copy's id."""
    tags = run.data.tags | {_COPYING: run.info.run_id}
    if _PARENT in tags:
        tags[_PARENT] = known.get(tags[_PARENT], tags[_PARENT])
    copied = new.create_run(experiment, run.info.start_time, tags, run.info.run_name).info.run_id
    params = [Param(key, value) for key, value in run.data.params.items()]
    points = [
        one for key in run.data.metrics for one in old.get_metric_history(run.info.run_id, key)
    ]
    _log(new, copied, params, points)
    new.log_inputs(copied, run.inputs.dataset_inputs)
    if old.list_artifacts(run.info.run_id):
        with TemporaryDirectory() as folder:
            old.download_artifacts(run.info.run_id, "", folder)
            new.log_artifacts(copied, folder)
    new.set_terminated(copied, run.info.status, run.info.end_time)
    new.set_tag(copied, _COPIED, run.info.run_id)
    return str(copied)


def _log(
    client: MlflowClient, run_id: str, params: Sequence[Param], points: Sequence[Metric]
) -> None:
    for start in range(0, len(params), _MOST_PARAMS):
        client.log_batch(run_id, params=params[start : start + _MOST_PARAMS])
    for start in range(0, len(points), _MOST_METRICS):
        client.log_batch(run_id, metrics=points[start : start + _MOST_METRICS])


if __name__ == "__main__":
    main()
