"""Records of detected instruments against hand-computed values."""

import numpy as np

from shaftpose.metrics.common_instruments import FoundInstruments, found_instruments
from shaftpose.metrics.pose_errors import errors_between

POSE = np.array([[1.0, 2.0, 20.0, 70.0, 100.0]])


def test_errors_are_kept_to_the_micrometre() -> None:
    moved = POSE + np.array([[-0.30149, 0.4, 0.0, 0.0, 0.0]])
    kept = found_instruments(errors_between(moved, POSE), total=3)
    errors = {
        "x_mm": [0.301], "y_mm": [0.4], "z_mm": [0.0], "pitch_deg": [0.0], "yaw_deg": [0.0],
        "axis_deg": [0.0], "tip_mm": [0.501],
    }  # fmt: skip
    assert kept == FoundInstruments(3, [0], errors)
