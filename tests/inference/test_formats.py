"""Results as text."""

import csv
import io
import json
from dataclasses import replace

import numpy as np
import pytest

from shaftpose.core.geometry import ShaftPose
from shaftpose.errors import InputError
from shaftpose.inference.formats import FORMATS, bop_lines, csv_lines, json_line
from shaftpose.inference.found_shafts import FoundShaft
from shaftpose.inference.frames import Frame

RGB = np.zeros((4, 4, 3), dtype=np.uint8)
AXIS = np.array([[30.04, 40.0], [50.0, 60.26]])
SHAFT = FoundShaft(
    0.87654, np.array([1.0, 2.04, 3, 4]), AXIS, ShaftPose(1, -2, 20.125, 90, 0), True
)


def test_json_lines_hold_a_frame_each() -> None:
    assert (
        json_line(Frame("a.png", 0, RGB), [])
        == '{"image": "a.png", "frame": 0, "instruments": []}\n'
    )
    line = json_line(Frame("clip.mp4", 7, RGB, 25.0), [SHAFT, SHAFT])
    assert line.count("\n") == 1
    content = json.loads(line)
    assert (content["image"], content["frame"]) == ("clip.mp4", 7)
    assert content["instruments"] == 2 * [{
        "score": 0.8765, "box": [1, 2, 3, 4], "tip_px": [30, 40], "axis_px": [[30, 40], [50, 60.3]],
        "x_mm": 1, "y_mm": -2, "z_mm": 20.12, "pitch_deg": 90, "yaw_deg": 0, "metric": True,
        "deviations": None, "track": None,
    }]  # fmt: skip


def test_json_lines_state_the_deviations_of_fitted_poses() -> None:
    fitted = replace(SHAFT, deviations=np.array([0.1, 0.2, 0.30004, 4.0, 5.0]))
    (row,) = json.loads(json_line(Frame("a.png", 0, RGB), [fitted]))["instruments"]
    assert row["deviations"] == {
        "x_mm": 0.1, "y_mm": 0.2, "z_mm": 0.3, "pitch_deg": 4.0, "yaw_deg": 5.0,
    }  # fmt: skip


def test_csv_holds_a_shaft_in_a_line() -> None:
    text = FORMATS["csv"].header + csv_lines(Frame("a, b.png", 0, RGB), [SHAFT])
    (row,) = csv.DictReader(io.StringIO(text))
    assert row["image"] == "a, b.png"
    assert [row[name] for name in ("x1", "tip_x_px", "axis_y_px")] == ["3.0", "30.0", "60.3"]
    assert (row["z_mm"], row["metric"]) == ("20.12", "true")
    assert csv_lines(Frame("a.png", 0, RGB), []) == ""


def test_bops_table_holds_rotation_and_translation() -> None:
    """Pitch 90, yaw 0: the shaft's z is the camera's x, its x the camera's z."""
    text = FORMATS["bop"].header + bop_lines(Frame("data/000003/rgb/000012.png", 0, RGB), [SHAFT])
    (row,) = csv.DictReader(io.StringIO(text))
    assert [row[name] for name in ("scene_id", "im_id", "obj_id", "time")] == ["3", "12", "1", "-1"]
    rotation = np.array(row["R"].split(), dtype=float).reshape(3, 3)
    assert rotation == pytest.approx(np.array([[0, 0, 1], [0, -1, 0], [1, 0, 0]]), abs=1e-6)
    assert row["t"] == "1.000 -2.000 20.125"


def test_bops_numbers_come_from_names_or_frames() -> None:
    assert bop_lines(Frame("12.png", 0, RGB), [SHAFT]).startswith("1,12,")
    assert bop_lines(Frame("clip.mp4", 7, RGB, 25.0), [SHAFT]).startswith("1,7,")
    with pytest.raises(InputError, match="--format bop needs a number"):
        bop_lines(Frame("frame.png", 0, RGB), [SHAFT])
