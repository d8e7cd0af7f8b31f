"""Experiment tracking; the only module that uses MLflow.

Each training has its own id, stored next to its checkpoint and as a tag of its run. Later stages
find the run by this id, or create one if the database was not copied along with the models.
"""

import logging
import os
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, NamedTuple

os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")  # read when mlflow is imported

import mlflow  # noqa: E402
import numpy as np  # noqa: E402
import onnx  # noqa: E402
import yaml  # noqa: E402
from filelock import FileLock  # noqa: E402
from mlflow.data.code_dataset_source import CodeDatasetSource  # noqa: E402
from mlflow.data.meta_dataset import MetaDataset  # noqa: E402
from mlflow.entities import LoggedModelStatus, Run, RunStatus  # noqa: E402
from mlflow.exceptions import MlflowException  # noqa: E402
from mlflow.models import infer_signature  # noqa: E402

from shaftpose.core.errors import InputError  # noqa: E402
from shaftpose.nested import flatten  # noqa: E402

if TYPE_CHECKING:
    from lightning.pytorch.loggers import MLFlowLogger

logger = logging.getLogger(__name__)

TRAINING_TAG = "shaftpose.training"
MODEL_NAME = "shaftpose"
CHAMPION = "champion"
_PARENT_FILE = "mlflow_parent.txt"
_TRIES = 5


def connect(uri: str | None, experiment: str) -> str:
    """Select server and experiment for this process; return the URI.

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
            f"MLflow at {uri}, experiment {experiment}: {error}; mend this, or set another "
            "tracking.uri (MLFLOW_TRACKING_URI) or tracking.experiment"
        ) from error
    return uri


def workspace(folder: Path) -> Path:
    """The user's project folder. `dvc exp run --queue` works in a copy below `.dvc/tmp/exps`; its
    tracked runs must outlive that copy."""
    parts = folder.resolve().parts
    for n, part in enumerate(parts):
        if part == ".dvc" and parts[n + 1 : n + 3] == ("tmp", "exps"):
            return Path(*parts[:n])
    return folder.resolve()


@contextmanager
def training_run(
    training_id: str,
    name: str,
    parameters: Mapping[str, Any],
    dataset: Mapping[str, str],
    sweep_folder: Path,
) -> "Iterator[MLFlowLogger]":
    """Open the MLflow run of one training, with system metrics; yield Lightning's logger for it.

    A resumed training continues its existing run.
    parameters: nested, logged flat; dataset: name -> digest of the training data;
    sweep_folder: if `start_sweep` was called for it, the run is nested under the sweep's run.
    """
    from lightning.pytorch.loggers import MLFlowLogger  # slow to import; only trainings need it

    parent, known = _read_parent(sweep_folder), _find_run(training_id)
    with mlflow.start_run(
        run_id=known,
        run_name=name,
        parent_run_id=parent,
        nested=parent is not None,
        tags={TRAINING_TAG: training_id},
        log_system_metrics=True,
    ) as run:
        if known is None:
            _log_origin(parameters, dataset)
        yield MLFlowLogger(
            experiment_name=mlflow.get_experiment(run.info.experiment_id).name,
            tracking_uri=mlflow.get_tracking_uri(),
            run_id=run.info.run_id,
        )


def _log_origin(parameters: Mapping[str, Any], dataset: Mapping[str, str]) -> None:
    mlflow.log_params(flatten(parameters))
    mlflow.set_tags({f"dataset.{path}": digest for path, digest in dataset.items()})
    digest = dataset.get("data/render", "unknown")[:36]
    source = CodeDatasetSource(tags={"stage": "render"})
    mlflow.log_input(MetaDataset(source, name="data/render", digest=digest), context="training")


def start_sweep(folder: Path, name: str) -> None:
    """Create the parent run of a sweep before its jobs start; record it in the sweep's folder.

    A resumed sweep keeps its parent run, if the database still holds it.
    """
    known = _read_parent(folder)
    if known is not None and _is_in_database(known):
        return
    with mlflow.start_run(run_name=name) as run:
        mlflow.set_tag("shaftpose.sweep", str(folder))
    folder.mkdir(parents=True, exist_ok=True)
    (folder / _PARENT_FILE).write_text(run.info.run_id)


class SweepRun(NamedTuple):
    """A training of a sweep: MLflow's run id, whether it finished, its parameters, the steps up to
    its last validation and the metrics of that validation, such as `validation/mAP`."""

    run_id: str
    finished: bool
    parameters: dict[str, str]
    steps: int
    metrics: dict[str, float]


def sweep_runs(folder: Path) -> list[SweepRun]:
    """The trainings of a sweep, including unfinished ones, in the order of first starts.

    Of trainings with equal parameters only the last is returned: a job is retrained if code or data
    change. Raises InputError if no sweep was tracked from `folder`.
    """
    parent = _read_parent(folder)
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


def _read_parent(folder: Path) -> str | None:
    note = folder / _PARENT_FILE
    return note.read_text() if note.is_file() else None


def _is_in_database(run_id: str) -> bool:
    found: list[Run] = mlflow.search_runs(
        filter_string=f"attributes.run_id = '{run_id}'", output_format="list"
    )
    return bool(found)


def log_results(
    training_id: str, name: str, metrics: Mapping[str, float | None], figures: Mapping[str, Path]
) -> None:
    """Add test metrics (None is skipped) and figures (title -> file) to a training's run."""
    known = {key: float(value) for key, value in metrics.items() if value is not None}
    with mlflow.start_run(run_id=_run_of(training_id, name)):
        mlflow.log_metrics(known)
        for path in figures.values():
            mlflow.log_artifact(str(path), "figures")


def log_model(training_id: str, name: str, model: Path, example: np.ndarray) -> None:
    """Add an ONNX file with its signature to a training's run.

    example: images (N, H, W, 3) uint8, the model's input.
    """
    import onnxruntime

    session = onnxruntime.InferenceSession(str(model), providers=["CPUExecutionProvider"])
    names = [output.name for output in session.get_outputs()]
    outputs = dict(zip(names, session.run(None, {"image": example}), strict=True))
    with mlflow.start_run(run_id=_run_of(training_id, name)):
        mlflow.onnx.log_model(
            onnx.load(str(model)),
            name="model",
            signature=infer_signature({"image": example}, outputs),
            pip_requirements=["onnxruntime", "numpy"],
        )


def register_champion(training_id: str, name: str, rule: str) -> None:
    """Register the last exported model of a training and give it the alias `champion`.

    Only warns if the run holds no model, because it was logged to another database.
    """
    client = mlflow.MlflowClient()
    model = _last_model(client, _run_of(training_id, name))
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
    """The ONNX file of a registered model, as long as the block lasts.

    name: `NAME@ALIAS` or `NAME/VERSION`, in the server of MLFLOW_TRACKING_URI, else in mlflow.db.
    Raises InputError if it is not there.
    """
    database = workspace(Path.cwd()) / "mlflow.db"
    uri = os.environ.get("MLFLOW_TRACKING_URI")
    if not uri and not database.is_file():  # which MLflow would create
        raise InputError(
            f"mlflow:/{name}: there is no {database}; go to the project's folder, or set "
            "MLFLOW_TRACKING_URI"
        )
    mlflow.set_tracking_uri(uri or f"sqlite:///{database}")
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
    """The URI of the last model logged to a run, if any; each export logs one. Deleted models and
    incomplete uploads do not count."""
    run = client.get_run(run_id)
    found = client.search_logged_models(
        [run.info.experiment_id],
        filter_string=f"source_run_id = '{run_id}'",
        order_by=[{"field_name": "creation_timestamp", "ascending": False}],
    )
    whole = [model.model_id for model in found if model.status == LoggedModelStatus.READY]
    return f"models:/{whole[0]}" if whole else None


def _champion(client: mlflow.MlflowClient) -> str | None:
    """The URI of the current champion, if any."""
    try:
        return str(client.get_model_version_by_alias(MODEL_NAME, CHAMPION).source)
    except mlflow.exceptions.MlflowException:  # no champion yet
        return None


def _run_of(training_id: str, name: str) -> str:
    """The run id of a training; creates a run if this database lacks it."""
    known = _find_run(training_id)
    if known is not None:
        return known
    with mlflow.start_run(run_name=name) as run:
        mlflow.set_tag(TRAINING_TAG, training_id)
    return str(run.info.run_id)


def _find_run(training_id: str) -> str | None:
    found: list[Run] = mlflow.search_runs(
        filter_string=f"tags.`{TRAINING_TAG}` = '{training_id}'", output_format="list"
    )
    return str(found[0].info.run_id) if found else None


def dataset_identity(lock: Path) -> dict[str, str]:
    """Path -> DVC hash of every output of the data stages in `dvc.lock`."""
    stages = _locked_stages(lock)
    outs = [out for name, entry in stages.items() if "@" not in name for out in entry["outs"]]
    return {out["path"]: out["md5"] for out in outs if out["path"].startswith("data/")}


def _locked_stages(lock: Path) -> dict[str, Any]:
    """The stages in `dvc.lock`; retries because another `dvc repro` may be writing the file."""
    for _ in range(_TRIES):
        if not lock.is_file():
            return {}
        try:
            stages: dict[str, Any] = yaml.safe_load(lock.read_text())["stages"]
            return stages
        except (yaml.YAMLError, TypeError, KeyError):
            time.sleep(0.5)
    logger.warning("%s cannot be read: the run will lack the hashes of its data", lock)
    return {}
