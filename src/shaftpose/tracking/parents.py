"""The name of a training's run, and the run in which it is nested: a sweep, or a run of DVC."""

import hashlib
import os
from collections.abc import Sequence
from pathlib import Path

import mlflow
from filelock import FileLock
from mlflow.entities import Run

from shaftpose.tracking.connection import workspace

# DVC sets the first for every stage, the second in `dvc exp run` alone.
STAGE, EXPERIMENT = "DVC_STAGE", "DVC_EXP_NAME"
_TAG = "shaftpose.repro"


def run_name(variant: str, overrides: Sequence[str], swept: Sequence[str] | None) -> str:
    """The variant and what differs from other runs, as `d  alpha=0.5 gamma=2`.

    swept: keys of the overrides that differ within a sweep; None outside of one, where all differ
    from params.yaml.
    """
    pairs = [override.lstrip("+").partition("=") for override in overrides]
    if swept is None:
        swept = [key for key, _, _ in pairs if key != "out" and not key.startswith("hydra")]
    parts = [f"{k.rpartition('.')[2]}={value}" for k, _, value in pairs if k in swept]
    parts = [part for part in parts if part != f"variant={variant}"]
    experiment = os.environ.get(EXPERIMENT)
    return "  ".join([variant, *filter(None, [" ".join(parts), experiment])])


def repro_run() -> str | None:
    """The id of the run that holds those of one `dvc repro`; None outside of DVC.

    It is found by the name of DVC's experiment, or else by the content of params.yaml: stages are
    processes of their own. The first one creates it.
    """
    if STAGE not in os.environ:
        return None
    digest = hashlib.sha256(Path("params.yaml").read_bytes()).hexdigest()[:12]
    name = os.environ.get(EXPERIMENT) or f"dvc repro {digest}"
    with FileLock(workspace(Path.cwd()) / ".mlflow.lock"):  # variants may start concurrently
        found: list[Run] = mlflow.search_runs(
            filter_string=f"tags.`{_TAG}` = '{name}'", output_format="list"
        )
        if found:
            return str(found[0].info.run_id)
        with mlflow.start_run(run_name=name, tags={_TAG: name}) as run:
            mlflow.log_artifact("params.yaml")
    return str(run.info.run_id)


def log_report(page: Path) -> None:
    """Add the report to the run of its `dvc repro`; nothing outside of DVC."""
    parent = repro_run()
    if parent is not None:
        mlflow.MlflowClient().log_artifact(parent, str(page))
