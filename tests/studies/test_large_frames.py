"""The table of errors in large frames."""

from pathlib import Path

import numpy as np
import pytest

from shaftpose.core.errors import InputError
from shaftpose.core.instruments import Detections
from shaftpose.settings.compose import composed_settings
from studies.large_frames import error_table, poses, table

ROOT = Path(__file__).parents[2]


def test_errors_are_of_the_shafts_that_all_runs_found() -> None:
    one, three, far = (np.array([size, -size, 0.0, 0.0, 0.0]) for size in (1.0, 3.0, 50.0))
    errors = {
        "299 px": {(0, 0): three, (0, 1): -one, (1, 0): three, (2, 0): far},
        "897 px": {(0, 0): one, (0, 1): one, (1, 0): 0 * one},
    }
    lines = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in error_table(errors, 5).splitlines()
    ]
    assert [line[:5] for line in lines[2:]] == [
        ["299 px", "3 of 5", "median", "3.00", "3.00"],
        ["299 px", "3 of 5", "mean", "2.33", "2.33"],
        ["897 px", "3 of 5", "median", "1.00", "1.00"],
        ["897 px", "3 of 5", "mean", "0.67", "0.67"],
    ]


def test_poses_are_named() -> None:
    found = Detections(np.zeros((1, 4)), np.ones(1), np.array([[1.0, 2.0, 20.0, 70.0, 350.0]]))
    assert poses(found) == [
        {"x_mm": 1.0, "y_mm": 2.0, "z_mm": 20.0, "pitch_deg": 70.0, "yaw_deg": 350.0}
    ]


def test_a_camera_that_the_model_does_not_know_is_refused() -> None:
    settings = composed_settings(ROOT, "camera.view_deg=70")
    with pytest.raises(InputError, match=r"camera\.view_deg is 70, but .* trained for 95"):
        table(settings, frames=1)
