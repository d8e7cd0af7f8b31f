import sys
from pathlib import Path

import mlflow
import pytest

from shaftpose import tracking
from shaftpose.errors import InputError

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))

import ui_screenshot  # noqa: E402


def test_a_server_that_is_tracked_to_shows_its_own_pages() -> None:
    previous = mlflow.get_tracking_uri()
    mlflow.set_tracking_uri("http://tracking.example:5000/")
    try:
        with ui_screenshot.server() as address:
            assert address == "http://tracking.example:5000"
    finally:
        mlflow.set_tracking_uri(previous)


def test_a_sweep_with_nothing_to_compare_is_refused(store: Path) -> None:
    (store / "params.yaml").write_text("tracking: {uri: null, experiment: trials}\n")
    tracking.start_sweep(store / "today", "sweep")
    with tracking.training_run("only", "d", {}, {}, store / "today"):
        pass
    with pytest.raises(InputError, match="today: 1 of its trainings are finished; wait for two"):
        ui_screenshot.comparison(store / "today")
