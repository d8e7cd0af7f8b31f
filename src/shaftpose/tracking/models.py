"""Exported models in MLflow: logged to their training's run, and the registered champion."""

import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import mlflow
import numpy as np
import onnx
from mlflow.entities import LoggedModelStatus
from mlflow.exceptions import MlflowException
from mlflow.models import infer_signature

from shaftpose.core.errors import InputError
from shaftpose.tracking.connection import select_store, workspace
from shaftpose.tracking.trainings import run_of

logger = logging.getLogger(__name__)

MODEL_NAME = "shaftpose"
CHAMPION = "champion"


def log_model(training_id: str, name: str, model: Path, example: np.ndarray) -> None:
    """Add an ONNX file with its signature to a training's run.

    example: images (N, H, W, 3) uint8, the model's input.
    """
    import onnxruntime

    session = onnxruntime.InferenceSession(str(model), providers=["CPUExecutionProvider"])
    names = [output.name for output in session.get_outputs()]
    outputs = dict(zip(names, session.run(None, {"image": example}), strict=True))
    with mlflow.start_run(run_id=run_of(training_id, name)):
        mlflow.onnx.log_model(
            onnx.load(str(model)),
            name="model",
            signature=infer_signature({"image": example}, outputs),
            pip_requirements=["onnxruntime", "numpy"],
        )


def register_champion(training_id: str, name: str, rule: str) -> None:
    """Register the last exported model of a training and give it the alias `champion`.

    If the run holds no model, because it was logged to another database, only warns.
    """
    client = mlflow.MlflowClient()
    model = _last_model(client, run_of(training_id, name))
    if model is None:
        logger.warning(
            "%s: this MLflow database lacks its model; run `dvc repro -s -f export`", name
        )
        return
    if _champion(client) == model:
        return
    version = mlflow.register_model(model, MODEL_NAME)
    client.update_model_version(MODEL_NAME, version.version, f"{name}: {rule}")
    client.set_registered_model_alias(MODEL_NAME, CHAMPION, version.version)


@contextmanager
def registered_model(name: str) -> Iterator[Path]:
    """Download a registered model; its ONNX file exists until the block ends.

    name: `NAME@ALIAS` or `NAME/VERSION`, at the server MLFLOW_TRACKING_URI if set, else in the
    project's mlflow.db. Raises InputError if the model cannot be loaded.
    """
    root = workspace(Path.cwd())
    database = root / "mlflow.db"
    if not os.environ.get("MLFLOW_TRACKING_URI") and not database.is_file():  # MLflow would make it
        raise InputError(
            f"mlflow:/{name}: there is no {database}; go to the project's folder, or set "
            "MLFLOW_TRACKING_URI"
        )
    select_store(None, root)
    os.environ.setdefault("MLFLOW_ENABLE_ARTIFACTS_PROGRESS_BAR", "false")
    with TemporaryDirectory() as folder:
        try:
            found = mlflow.artifacts.download_artifacts(f"models:/{name}", dst_path=folder)
        except Exception as error:  # databases and stores have exceptions of their own
            reason = (str(error) or repr(error)).splitlines()[0]
            raise InputError(f"mlflow:/{name}: cannot be loaded ({reason})") from error
        model = Path(found) / "model.onnx"
        if not model.is_file():
            raise InputError(f"mlflow:/{name}: has no model.onnx; name a model of the pipeline")
        yield model


def _last_model(client: mlflow.MlflowClient, run_id: str) -> str | None:
    """The URI of the last model logged to a run, None if it has none; each export logs one.

    Deleted models and incomplete uploads do not count.
    """
    run = client.get_run(run_id)
    found = client.search_logged_models(
        [run.info.experiment_id],
        filter_string=f"source_run_id = '{run_id}'",
        order_by=[{"field_name": "creation_timestamp", "ascending": False}],
    )
    whole = [model.model_id for model in found if model.status == LoggedModelStatus.READY]
    return f"models:/{whole[0]}" if whole else None


def _champion(client: mlflow.MlflowClient) -> str | None:
    """The URI of the current champion, None if there is none."""
    try:
        return str(client.get_model_version_by_alias(MODEL_NAME, CHAMPION).source)
    except MlflowException:  # no champion yet
        return None
