"""What is kept of the instruments that a training found, by hand."""

import numpy as np

from shaftpose.evaluation.common_instruments import (
    FoundInstruments,
    found_instruments,
)
from shaftpose.evaluation.pose_errors import errors_between

POSE = np.array([[1.0, 2.0, 20.0, 70.0, 100.0]])
BOX = np.array([[0.0, 0.0, 9.0, 9.0]])


def test_errors_are_kept_to_the_micrometre() -> None:
    moved = POSE + np.array([[0.30004, 0.4, 0.0, 0.0, 0.0]])
    kept = found_instruments(errors_between(moved, POSE), total=3)
    assert kept == FoundInstruments(3, [0], [0.5], [0.0])
