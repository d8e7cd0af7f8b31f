"""Saved views of MLflow's page."""

import json
from pathlib import Path

import mlflow
import pytest

from shaftpose.tracking.connection import connect
from shaftpose.tracking.views import view_link, view_links, view_tag


def test_a_new_experiment_has_a_view_and_its_address(store: Path) -> None:
    number = mlflow.get_experiment_by_name("trials").experiment_id
    page = "runs?viewStateShareKey=shaftpose&workflowType=MACHINE_LEARNING"
    address = f"http://127.0.0.1:5000/#/experiments/{number}/{page}"
    assert view_link("trials") == address
    assert view_links() == [f"trials: {address}"]
    tags = mlflow.get_experiment_by_name("trials").tags
    saved = json.loads(tags["mlflow.sharedViewState.shaftpose"])
    state = json.loads(saved["state"])
    assert {"metrics.`test/mAP`", "metrics.`test/tip_mm`", "params.`loss.alpha`"} <= set(
        state["selectedColumns"]
    )


def test_a_view_is_sorted_by_its_first_metric() -> None:
    columns = ["tags.`best`", "metrics.`validation/mAP`", "metrics.`validation/tip_mm`"]
    (value,) = view_tag(columns, expanded="ab").values()
    state = json.loads(json.loads(value)["state"])
    assert (state["orderByKey"], state["orderByAsc"]) == (columns[1], False)
    assert state["columnOrder"][1:4] == columns
    assert state["runsExpanded"] == {"ab": True}


def test_on_a_server_the_address_is_its_own(store: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    connect(None, "others")
    monkeypatch.setattr(mlflow, "get_tracking_uri", lambda: "http://server:5000/")
    assert view_link("others").startswith("http://server:5000/#/experiments/")
