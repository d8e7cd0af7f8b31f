"""Exported models in MLflow: logged to their training's run, and downloaded for prediction."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import mlflow
import numpy as np
import onnx
from mlflow.models import infer_signature

from shaftpose.core.errors import InputError
from shaftpose.tracking.connection import select_store, workspace
from shaftpose.tracking.trainings import reopened_run


def log_model(training_id: str, name: str, model: Path, example: np.ndarray) -> None:
    """Add an ONNX file with its signature to a training's run.

    example: images (N, H, W, 3) uint8, the model's input.
    """
    import onnxruntime

    session = onnxruntime.InferenceSession(str(model), providers=["CPUExecutionProvider"])
    names = [output.name for output in session.get_outputs()]
    outputs = dict(zip(names, session.run(None, {"image": example}), strict=True))
    with reopened_run(training_id, name):
        mlflow.onnx.log_model(
            onnx.load(str(model)),
            name="model",
            signature=infer_signature({"image": example}, outputs),
            pip_requirements=["onnxruntime", "numpy"],
        )


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
