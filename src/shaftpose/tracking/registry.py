"""The registered model `shaftpose`: its newest candidate, and the champion that people use."""

import logging
import os
from collections.abc import Callable, Mapping

import mlflow
from mlflow.entities import LoggedModelStatus
from mlflow.entities.model_registry import ModelVersion
from mlflow.exceptions import MlflowException

from shaftpose.tracking.parents import EXPERIMENT
from shaftpose.tracking.trainings import run_of

logger = logging.getLogger(__name__)

MODEL_NAME = "shaftpose"
CHAMPION, CANDIDATE = "champion", "candidate"
TRIAL = "smoke"  # the profile that learns nothing

Tags = Mapping[str, str]


def register_candidate(
    training_id: str, name: str, rule: str, tags: Tags, is_better: Callable[[Tags], bool]
) -> None:
    """Make the last exported model of a training the `candidate` and, if it may be, the `champion`.

    tags: the model's, `profile` and `dataset` among them; is_better: whether it is better than
    another model, given by its tags. These never become champion: a smoke run, a DVC experiment, a
    model measured on other data than the present champion, or one that is no better. If the run
    holds no model, because it was logged to another database, only warns.
    """
    client = mlflow.MlflowClient()
    model = _last_model(client, run_of(training_id, name))
    if model is None:
        logger.warning(
            "%s: this MLflow database lacks its model; run `dvc repro -s -f export`", name
        )
        return
    version = _version_of(client, model)
    client.update_model_version(MODEL_NAME, version, f"{name}: {rule}")
    for key, value in tags.items():
        client.set_model_version_tag(MODEL_NAME, version, key, value)
    client.set_registered_model_alias(MODEL_NAME, CANDIDATE, version)
    champion = _champion(client)
    if champion is not None and str(champion.version) == version:
        return
    refusal = _refusal(tags, champion, is_better)
    if refusal is None:
        client.set_registered_model_alias(MODEL_NAME, CHAMPION, version)
    else:
        logger.info(
            "model %s version %s (%s) is the candidate, not the champion: %s; `make ui`, Models, "
            "can move the alias", MODEL_NAME, version, name, refusal,
        )  # fmt: skip


def _refusal(
    tags: Tags, champion: ModelVersion | None, is_better: Callable[[Tags], bool]
) -> str | None:
    """Why a model does not become champion; None if it does."""
    if tags["profile"] == TRIAL:
        return f"the profile {TRIAL} is for tests"
    if EXPERIMENT in os.environ:
        return "it is a DVC experiment"
    if champion is None:
        return None
    if champion.tags.get("dataset") != tags["dataset"]:
        return f"version {champion.version} was measured on other images"
    return None if is_better(champion.tags) else f"version {champion.version} is no worse"


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


def _version_of(client: mlflow.MlflowClient, model: str) -> str:
    """The version of a model in the registry; registers the model if it has none."""
    known = client.search_model_versions(f"name = '{MODEL_NAME}'")
    versions = [str(one.version) for one in known if one.source == model]
    return versions[0] if versions else str(mlflow.register_model(model, MODEL_NAME).version)


def _champion(client: mlflow.MlflowClient) -> ModelVersion | None:
    try:
        return client.get_model_version_by_alias(MODEL_NAME, CHAMPION)
    except MlflowException:  # no champion yet
        return None
