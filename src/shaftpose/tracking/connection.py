"""Choice of the MLflow server or database, and of the experiment."""

import logging
import os
from pathlib import Path

import mlflow
from filelock import FileLock
from mlflow.exceptions import MlflowException

from shaftpose.core.errors import InputError


def connect(uri: str | None, experiment: str) -> None:
    """Select the MLflow server and the experiment of this process.

    uri: an MLflow server; None selects MLFLOW_TRACKING_URI if set, else `mlflow.db` in the project
    folder, with artifacts in `mlruns`. Raises InputError if the server or the database cannot be
    used, or if the experiment was deleted.
    """
    root = workspace(Path.cwd())
    uri = uri or os.environ.get("MLFLOW_TRACKING_URI") or f"sqlite:///{root / 'mlflow.db'}"
    mlflow.set_tracking_uri(uri)
    logging.getLogger("mlflow").setLevel(logging.WARNING)
    location = (root / "mlruns").as_uri() if uri.startswith("sqlite:") else None
    # Trainings may start concurrently: only one of them creates database and experiment.
    try:
        with FileLock(root / ".mlflow.lock"):
            if mlflow.get_experiment_by_name(experiment) is None:
                mlflow.create_experiment(experiment, artifact_location=location)
            mlflow.set_experiment(experiment)
    except (MlflowException, OSError, ImportError) as error:
        raise InputError(
            f"MLflow at {uri}, experiment {experiment}: {error}; fix this, or set another "
            "tracking.uri (MLFLOW_TRACKING_URI) or tracking.experiment"
        ) from error


def workspace(folder: Path) -> Path:
    """The user's project folder, which outlives the working directory `folder`.

    `dvc exp run --queue` works in a copy of the project below `.dvc/tmp/exps` and deletes it.
    """
    parts = folder.resolve().parts
    for n, part in enumerate(parts):
        if part == ".dvc" and parts[n + 1 : n + 3] == ("tmp", "exps"):
            return Path(*parts[:n])
    return folder.resolve()
