"""The MLflow run of a training: its parameters, data, metrics and figures."""

import shlex
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import mlflow
from mlflow.data.code_dataset_source import CodeDatasetSource
from mlflow.data.meta_dataset import MetaDataset
from mlflow.entities import Run
from mlflow.exceptions import MlflowException

from shaftpose.settings.parsing import as_plain, flatten
from shaftpose.tracking.parents import repro_run, run_name
from shaftpose.tracking.sweeps import OVERRIDES_TAG, read_sweep
from shaftpose.tracking.validations import repeat_kept_validation
from shaftpose.tracking.views import run_link

if TYPE_CHECKING:
    from lightning.pytorch.loggers import MLFlowLogger

TRAINING_TAG = "shaftpose.training"


@contextmanager
def training_run(
    training_id: str,
    variant: str,
    parameters: Mapping[str, Any],
    dataset: Mapping[str, str],
    images: str,
    sweep_folder: Path,
    overrides: Sequence[str] = (),
    settings: object = None,
) -> "Iterator[MLFlowLogger]":
    """Open the MLflow run of one training, with system metrics; yield Lightning's logger for it.

    A resumed training continues its run. parameters: nested, logged flat. dataset: name -> digest
    of the training's data; images: the name of its training images. sweep_folder: the run is
    nested in the sweep's run if `start_sweep` was called for this folder, else in that of its
    `dvc repro`. overrides: of the command line; settings: all resolved ones, kept as a file if they
    are known.
    """
    from lightning.pytorch.loggers import MLFlowLogger  # slow to import; only trainings need it

    sweep = read_sweep(sweep_folder)
    if sweep is not None:
        mlflow.set_experiment(sweep.experiment)
    parent, known = sweep.run_id if sweep else repro_run(), _find_run(training_id)
    if known is not None:
        _enter_experiment_of(known)
    with mlflow.start_run(
        run_id=known,
        run_name=run_name(variant, overrides, sweep.swept if sweep else None),
        parent_run_id=parent,
        nested=parent is not None,
        tags={TRAINING_TAG: training_id, OVERRIDES_TAG: shlex.join(overrides)},
        log_system_metrics=True,
    ) as run:
        if known is None:
            _log_inputs(parameters, dataset, images)
            if settings is not None:
                mlflow.log_dict(as_plain(settings), "settings.yaml")
        yield MLFlowLogger(
            experiment_name=mlflow.get_experiment(run.info.experiment_id).name,
            tracking_uri=mlflow.get_tracking_uri(),
            run_id=run.info.run_id,
        )
        repeat_kept_validation(run.info.run_id)


def _log_inputs(parameters: Mapping[str, Any], dataset: Mapping[str, str], images: str) -> None:
    mlflow.log_params(flatten(parameters))
    mlflow.set_tags({f"dataset.{path}": digest for path, digest in dataset.items()})
    digest = dataset.get(images, "unknown")[:36]  # MLflow's limit
    source = CodeDatasetSource(tags={"stage": "render"})
    render = MetaDataset(source, name=images, digest=digest)
    try:
        mlflow.log_input(render, context="training")
    except MlflowException:
        # Of trainings that start concurrently, each may find that MLflow does not know their
        # images yet, and all but the first then fail to add them. The second time they are known.
        mlflow.log_input(render, context="training")


def log_results(
    training_id: str, name: str, metrics: Mapping[str, Any], figures: Mapping[str, Path]
) -> None:
    """Add test metrics and figures (title -> file) to a training's run.

    metrics: nested, logged as `test/mAP`; None is skipped.
    """
    flat = flatten(metrics, "/")
    known = {key: float(value) for key, value in flat.items() if value is not None}
    with reopened_run(training_id, name):
        mlflow.log_metrics(known)
        for path in figures.values():
            mlflow.log_artifact(str(path), "figures")


@contextmanager
def reopened_run(training_id: str, name: str) -> Iterator[None]:
    """Make the run of a finished training the active one.

    Its end stays that of the training, so that MLflow shows how long the training took.
    """
    client, run_id = mlflow.MlflowClient(), run_of(training_id, name)
    end_time = client.get_run(run_id).info.end_time
    _enter_experiment_of(run_id)
    try:
        with mlflow.start_run(run_id=run_id):
            yield
    finally:  # the training is finished, even if what follows it has failed
        client.set_terminated(run_id, end_time=end_time)


def _enter_experiment_of(run_id: str) -> None:
    """Make the experiment of a run the active one: MLflow opens no run of another.

    It may be a sweep's, or that of earlier settings.
    """
    experiment = mlflow.MlflowClient().get_run(run_id).info.experiment_id
    mlflow.set_experiment(experiment_id=experiment)


def run_of(training_id: str, name: str) -> str:
    """The id of a training's run; creates a run if this database has none."""
    known = _find_run(training_id)
    if known is not None:
        return known
    with mlflow.start_run(run_name=name) as run:
        mlflow.set_tag(TRAINING_TAG, training_id)
    return str(run.info.run_id)


def training_link(training_id: str) -> str:
    """The address of a training's run; "" if this database has none."""
    run_id = _find_run(training_id)
    return run_link(run_id) if run_id else ""


def _find_run(training_id: str) -> str | None:
    found: list[Run] = mlflow.search_runs(
        filter_string=f"tags.`{TRAINING_TAG}` = '{training_id}'",
        search_all_experiments=True,
        output_format="list",
    )
    return str(found[0].info.run_id) if found else None
