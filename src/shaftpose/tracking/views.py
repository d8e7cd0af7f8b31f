"""Saved views of MLflow's page: a table of runs with the columns that tell them apart.

MLflow keeps a view as a tag of its experiment and opens it by a link.
"""

import json
import time
from collections.abc import Iterable

import mlflow

_VIEW = "mlflow.sharedViewState."
_NAME = "shaftpose"
# MLflow's ids of the columns that are always there.
_RUN, _CREATED = "attributes.`Run Name`", "runDateAndNestInfo"
_LOCAL = "http://127.0.0.1:5000"  # `make ui`
# Without these, MLflow opens its page for language models.
KIND, _KIND = {"mlflow.experimentKind": "custom_model_development"}, "MACHINE_LEARNING"
WEIGHTS = tuple(
    f"params.`loss.{name}`"
    for name in ("alpha", "gamma", *(f"beta.{part}" for part in ("x_mm", "z_mm", "pitch_deg")))
)


def results(prefix: str) -> list[str]:
    """The columns of the most important metrics; prefix: `test` or `validation`."""
    names = ("mAP", "tip_mm", "axis_deg", "detected_rate")
    return [f"metrics.`{prefix}/{name}`" for name in names]


def view_tag(columns: Iterable[str], expanded: str | None = None) -> dict[str, str]:
    """The tag of an experiment that holds its view.

    columns: as in MLflow's filters, ordered; the first metric sorts the runs. expanded: a parent
    run whose children are shown.
    """
    columns = list(columns)
    first = next(column for column in columns if column.startswith("metrics."))
    state = {
        "searchFilter": "", "orderByKey": first, "orderByAsc": False, "startTime": "ALL",
        "lifecycleFilter": "Active", "modelVersionFilter": "All Runs", "datasetsFilter": [],
        "selectedColumns": columns, "columnOrder": [_RUN, *columns, _CREATED, "duration"],
        "columnWidths": {_RUN: 200, _CREATED: 75, **{c: 6 * len(c) - 15 for c in columns}},
        "runsExpanded": {expanded: True} if expanded else {},
    }  # fmt: skip
    now = round(1000 * time.time())
    saved = {"name": _NAME, "createdAt": now, "updatedAt": now, "state": json.dumps(state)}
    return {f"{_VIEW}{_NAME}": json.dumps(saved)}


def view_link(experiment: str) -> str:
    """The address of an experiment's view."""
    page = _page(mlflow.get_experiment_by_name(experiment).experiment_id)
    return f"{page}?viewStateShareKey={_NAME}&workflowType={_KIND}"


def run_link(run_id: str) -> str:
    """The address of a run."""
    return f"{_page(mlflow.get_run(run_id).info.experiment_id)}/{run_id}"


def _page(experiment: str) -> str:
    """The address of an experiment's runs: on the tracking server, or where `make ui` serves."""
    uri = mlflow.get_tracking_uri()
    server = uri.rstrip("/") if uri.startswith("http") else _LOCAL
    return f"{server}/#/experiments/{experiment}/runs"


def view_links() -> list[str]:
    """The name and the view of each experiment, the newest last."""
    found = mlflow.search_experiments(order_by=["creation_time ASC"])
    views = (one for one in found if f"{_VIEW}{_NAME}" in one.tags)
    return [f"{one.name}: {view_link(one.name)}" for one in views]
