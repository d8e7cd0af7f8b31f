"""Choice of the MLflow server or database, and of the experiment."""

import logging
import os
from pathlib import Path
from urllib.error import HTTPError
from urllib.parse import urlparse
from urllib.request import url2pathname, urlopen

import mlflow
from filelock import FileLock
from mlflow.exceptions import MlflowException

from shaftpose.core.errors import InputError
from shaftpose.tracking.views import KIND, WEIGHTS, results, view_tag

_ANSWER_S = 10.0


def connect(uri: str | None, experiment: str) -> None:
    """Select the MLflow server and the experiment of this process.

    uri: an MLflow server; None selects MLFLOW_TRACKING_URI if set, else `mlflow.db` in the project
    folder, with artifacts in `mlruns`. Raises InputError if the server or the database cannot be
    used, or if the experiment was deleted.
    """
    root = workspace(Path.cwd())
    uri = select_store(uri, root)
    logging.getLogger("mlflow").setLevel(logging.WARNING)
    location = (root / "mlruns").as_uri() if uri.startswith("sqlite:") else None
    # Trainings may start concurrently: only one of them creates database and experiment.
    try:
        with FileLock(root / ".mlflow.lock"):
            if mlflow.get_experiment_by_name(experiment) is None:
                tags = KIND | view_tag([*results("test"), *WEIGHTS])
                mlflow.create_experiment(experiment, artifact_location=location, tags=tags)
            mlflow.set_experiment(experiment)
    except (MlflowException, OSError, ImportError) as error:
        raise InputError(
            f"MLflow at {uri}, experiment {experiment}: {error}; fix this, or set another "
            "tracking.uri (MLFLOW_TRACKING_URI) or tracking.experiment"
        ) from error


def select_store(uri: str | None, root: Path) -> str:
    """Select the MLflow server or the project's database, as for `connect`; returns its URI.

    Raises InputError if a server does not answer, or the project's folder was renamed.
    """
    own = f"sqlite:///{root / 'mlflow.db'}"
    uri = uri or os.environ.get("MLFLOW_TRACKING_URI") or own
    if uri.startswith("http"):
        _check_answer(uri)
    mlflow.set_tracking_uri(uri)
    if uri == own and (root / "mlflow.db").is_file():
        _check_folder(root)
    return uri


def _check_answer(uri: str) -> None:
    """Fail fast if the server does not answer: MLflow would retry for minutes."""
    try:
        urlopen(uri, timeout=_ANSWER_S).close()
    except HTTPError:  # it answers
        pass
    except (OSError, ValueError) as error:
        raise InputError(
            f"MLflow at {uri}: no answer ({error}); start the server, or go on without it: "
            "tracking.uri=null, with MLFLOW_TRACKING_URI unset, records in mlflow.db, and "
            "`python -m tools.copy_runs SERVER` copies its runs later"
        ) from error


def _check_folder(root: Path) -> None:
    """Refuse a moved folder: MLflow would write to its old path."""
    for experiment in mlflow.search_experiments():
        place = Path(url2pathname(urlparse(experiment.artifact_location).path))
        if place.name == "mlruns" and place.resolve() != root / "mlruns":
            raise InputError(
                f"{root / 'mlflow.db'}: the files of its runs are in {place}: this folder was "
                f"renamed or copied; `ln -s {root} {place.parent}`, or move mlflow.db away to "
                "begin a new one"
            )


def workspace(folder: Path) -> Path:
    """The user's project folder, which outlives the working directory `folder`.

    `dvc exp run --queue` works in a copy of the project below `.dvc/tmp/exps` and deletes it.
    """
    parts = folder.resolve().parts
    for n, part in enumerate(parts):
        if part == ".dvc" and parts[n + 1 : n + 3] == ("tmp", "exps"):
            return Path(*parts[:n])
    return folder.resolve()
