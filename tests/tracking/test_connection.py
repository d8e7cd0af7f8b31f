"""The choice of MLflow's server, database and experiment."""

import re
from pathlib import Path
from socket import socket

import mlflow
import pytest

from shaftpose.core.errors import InputError
from shaftpose.tracking import connection
from shaftpose.tracking.connection import connect, workspace
from shaftpose.tracking.models import registered_model


def test_a_queued_experiment_tracks_in_the_users_own_copy() -> None:
    assert workspace(Path("/home/me/p/.dvc/tmp/exps/tmpab12")) == Path("/home/me/p")
    assert workspace(Path("/home/me/p")) == Path("/home/me/p")


@pytest.mark.parametrize(
    "uri",
    [
        "sqlite:////proc/none/mlflow.db",
        "none://127.0.0.1",
    ],
)
@pytest.mark.usefixtures("store")
def test_a_store_that_cannot_be_used_is_named(uri: str) -> None:
    with pytest.raises(InputError, match=rf"^MLflow at {re.escape(uri)}, experiment trials: "):
        connect(uri, "trials")


def test_a_deleted_experiment_is_named(store: Path) -> None:
    client = mlflow.MlflowClient()
    client.delete_experiment(client.get_experiment_by_name("trials").experiment_id)
    with pytest.raises(InputError, match="experiment trials: .*deleted"):
        connect(None, "trials")


@pytest.mark.parametrize("listens", [True, False])
def test_a_server_that_does_not_answer_is_named_soon(
    listens: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connection, "_ANSWER_S", 0.2)
    with socket() as silent:
        silent.bind(("127.0.0.1", 0))
        if listens:  # and says nothing
            silent.listen()
        uri = f"http://127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(InputError, match=f"^MLflow at {uri}: no answer .* tracking.uri=null"):
            connect(uri, "trials")


def test_a_project_that_was_renamed_is_named_and_goes_on_by_a_link(
    store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    moved = store.rename(store.with_name("moved"))
    monkeypatch.chdir(moved)
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)  # MLflow sets it
    with pytest.raises(InputError, match=f"in {store}/mlruns: .*`ln -s {moved} {store}`"):
        connect(None, "trials")
    with (
        pytest.raises(InputError, match="this folder was renamed or copied"),
        registered_model("shaftpose@champion"),
    ):
        pass
    store.symlink_to(moved)
    connect(None, "trials")
