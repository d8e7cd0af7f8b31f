import sys
from pathlib import Path

import mlflow

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
