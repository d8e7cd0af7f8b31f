"""The MLflow run of a training: its parameters, data, metrics and figures."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import mlflow
from mlflow.data.code_dataset_source import CodeDatasetSource
from mlflow.data.meta_dataset import MetaDataset
from mlflow.entities import Run

from shaftpose.settings.parsing import flatten
from shaftpose.tracking.sweeps import read_parent

if TYPE_CHECKING:
    from lightning.pytorch.loggers import MLFlowLogger

TRAINING_TAG = "shaftpose.training"


@contextmanager
def training_run(
    training_id: str,
    name: str,
    parameters: Mapping[str, Any],
    dataset: Mapping[str, str],
    images: str,
    sweep_folder: Path,
) -> "Iterator[MLFlowLogger]":
    """Open the MLflow run of one training, with system metrics; yield Lightning's logger for it.

    A resumed training continues its run. parameters: nested, logged flat. dataset: name -> digest
    of the training's data; images: the name of its training images. sweep_folder: the run is
    nested in the sweep's run if `start_sweep` was called for this folder.
    """
    from lightning.pytorch.loggers import MLFlowLogger  # slow to import; only trainings need it

    parent, known = read_parent(sweep_folder), _find_run(training_id)
    with mlflow.start_run(
        run_id=known,
        run_name=name,
        parent_run_id=parent,
        nested=parent is not None,
        tags={TRAINING_TAG: training_id},
        log_system_metrics=True,
    ) as run:
        if known is None:
            _log_inputs(parameters, dataset, images)
        yield MLFlowLogger(
            experiment_name=mlflow.get_experiment(run.info.experiment_id).name,
            tracking_uri=mlflow.get_tracking_uri(),
            run_id=run.info.run_id,
        )


def _log_inputs(parameters: Mapping[str, Any], dataset: Mapping[str, str], images: str) -> None:
    mlflow.log_params(flatten(parameters))
    mlflow.set_tags({f"dataset.{path}": digest for path, digest in dataset.items()})
    digest = dataset.get(images, "unknown")[:36]  # MLflow's limit
    source = CodeDatasetSource(tags={"stage": "render"})
    mlflow.log_input(MetaDataset(source, name=images, digest=digest), context="training")


def log_results(
    training_id: str, name: str, metrics: Mapping[str, Any], figures: Mapping[str, Path]
) -> None:
    """Add test metrics and figures (title -> file) to a training's run.

    metrics: nested, logged as `raw/mAP`; None is skipped.
    """
    flat = flatten(metrics, "/")
    known = {key: float(value) for key, value in flat.items() if value is not None}
    with mlflow.start_run(run_id=run_of(training_id, name)):
        mlflow.log_metrics(known)
        for path in figures.values():
            mlflow.log_artifact(str(path), "figures")


def run_of(training_id: str, name: str) -> str:
    """The id of a training's run; creates a run if this database has none."""
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
