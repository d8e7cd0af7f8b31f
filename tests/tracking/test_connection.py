"""The choice of MLflow's server, database and experiment."""

import re
from pathlib import Path

import mlflow
import pytest

from shaftpose.core.errors import InputError
from shaftpose.tracking.connection import connect, workspace


def test_a_queued_experiment_tracks_in_the_users_own_copy() -> None:
    assert workspace(Path("/home/me/p/.dvc/tmp/exps/tmpab12")) == Path("/home/me/p")
    assert workspace(Path("/home/me/p")) == Path("/home/me/p")


@pytest.mark.parametrize(
    "uri",
    [
        "http://127.0.0.1:9",  # the port to which nobody listens
        "sqlite:////proc/none/mlflow.db",
        "none://127.0.0.1",
    ],
)
@pytest.mark.usefixtures("store")
def test_a_store_that_cannot_be_used_is_named(uri: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "0")
    with pytest.raises(InputError, match=rf"^MLflow at {re.escape(uri)}, experiment trials: "):
        connect(uri, "trials")


def test_a_deleted_experiment_is_named(store: Path) -> None:
    client = mlflow.MlflowClient()
    client.delete_experiment(client.get_experiment_by_name("trials").experiment_id)
    with pytest.raises(InputError, match="experiment trials: .*deleted"):
        connect(None, "trials")
