"""Results as text."""

import csv
import io
import json
from dataclasses import replace

import numpy as np
import pytest

from shaftpose.core.errors import InputError
from shaftpose.core.geometry import ShaftPose
from shaftpose.frame_sources.frames import Frame
from shaftpose.inference.formats import BopLines, csv_lines, format_of_run, json_line
from shaftpose.inference.found_shafts import FoundShaft

RGB = np.zeros((4, 4, 3), dtype=np.uint8)
AXIS = np.array([[30.04, 40.0], [50.0, 60.26]])
SHAFT = FoundShaft(
    0.87654, np.array([1.0, 2.04, 3, 4]), AXIS, ShaftPose(1, -2, 20.125, 90, 0), True, "hidden"
)


def test_json_lines_hold_a_frame_each() -> None:
    assert (
        json_line(Frame("a.png", 0, RGB), [])
        == '{"image": "a.png", "frame": 0, "time_s": null, "instruments": []}\n'
    )
    line = json_line(Frame("clip.mp4", 7, RGB, 0.28), [SHAFT, SHAFT])
    assert line.count("\n") == 1
    content = json.loads(line)
    assert [content[name] for name in ("image", "frame", "time_s")] == ["clip.mp4", 7, 0.28]
    assert content["instruments"] == 2 * [{
        "score": 0.8765, "box": [1, 2, 3, 4], "tip_px": [30, 40], "axis_px": [[30, 40], [50, 60.3]],
        "x_mm": 1, "y_mm": -2, "z_mm": 20.12, "pitch_deg": 90, "yaw_deg": 0, "metric": True,
        "tip": "hidden", "deviations": None, "track": None,
    }]  # fmt: skip


def test_a_yaw_is_below_360_once_it_is_rounded() -> None:
    nearly = replace(SHAFT, pose=replace(SHAFT.pose, yaw_deg=359.996))
    (shaft,) = json.loads(json_line(Frame("a.png", 0, RGB), [nearly]))["instruments"]
    assert shaft["yaw_deg"] == 0


def test_json_lines_state_the_deviations_of_fitted_poses() -> None:
    fitted = replace(SHAFT, deviations=np.array([0.1, 0.2, 0.30004, 4.0, 5.0]))
    (row,) = json.loads(json_line(Frame("a.png", 0, RGB), [fitted]))["instruments"]
    assert row["deviations"] == {
        "x_mm": 0.1, "y_mm": 0.2, "z_mm": 0.3, "pitch_deg": 4.0, "yaw_deg": 5.0,
    }  # fmt: skip


def test_csv_holds_a_shaft_in_a_line() -> None:
    text = format_of_run("csv").header + csv_lines(Frame("a, b.png", 0, RGB), [SHAFT])
    (row,) = csv.DictReader(io.StringIO(text))
    assert row["image"] == "a, b.png"
    assert [row[name] for name in ("x1", "tip_x_px", "axis_y_px")] == ["3.0", "30.0", "60.3"]
    assert (row["z_mm"], row["metric"], row["tip"]) == ("20.12", "true", "hidden")
    assert csv_lines(Frame("a.png", 0, RGB), []) == ""


@pytest.mark.parametrize("sign", ["=", "+", "-", "@", "\t", "\r"])
def test_no_name_is_a_formula(sign: str) -> None:
    text = csv_lines(Frame(f"{sign}1+1.jpg", 0, RGB), [SHAFT])
    ((name, *_),) = csv.reader(io.StringIO(text, newline=""))
    assert name == f"./{sign}1+1.jpg"
    assert csv_lines(Frame(f"a{sign}b.jpg", 0, RGB), [SHAFT]).lstrip('"').startswith("a")


def test_bops_table_holds_rotation_and_translation() -> None:
    """Pitch 90, yaw 0: the shaft's z is the camera's x, its x the camera's z."""
    bop = format_of_run("bop")
    text = bop.header + bop.lines(Frame("data/000003/rgb/000012.png", 0, RGB), [SHAFT])
    (row,) = csv.DictReader(io.StringIO(text))
    assert [row[name] for name in ("scene_id", "im_id", "obj_id", "time")] == ["3", "12", "1", "-1"]
    rotation = np.array(row["R"].split(), dtype=float).reshape(3, 3)
    assert rotation == pytest.approx(np.array([[0, 0, 1], [0, -1, 0], [1, 0, 0]]), abs=1e-6)
    assert row["t"] == "1.000 -2.000 20.125"


def read_bop(text: str) -> list[tuple[list[int], np.ndarray, np.ndarray, list[float]]]:
    """A table of results by the rules of the BOP challenge, which splits lines at commas and knows
    no quotes: scene, image and object; rotation by rows; translation in mm; score and time."""
    header, *lines = text.splitlines()
    assert header == "scene_id,im_id,obj_id,score,R,t,time"
    rows = []
    for line in lines:
        scene, image, shown, score, rotation, translation, time = line.split(",")
        matrix, vector = (np.array([*map(float, x.split())]) for x in (rotation, translation))
        numbers = [int(scene), int(image), int(shown)]
        rows.append((numbers, matrix.reshape(3, 3), vector.reshape(3), [float(score), float(time)]))
    return rows


def test_bops_table_is_read_by_bops_rules() -> None:
    rng = np.random.default_rng(3)
    low, high = [-20, -20, 10, 50, 0], [20, 20, 40, 90, 358]
    poses = [ShaftPose.from_array(row) for row in rng.uniform(low, high, (6, 5))]
    shafts = [replace(SHAFT, pose=pose, score=n / 7) for n, pose in enumerate(poses)]
    frames = [Frame(f"test/000002/rgb/{n:06d}.png", 0, RGB) for n in range(3)]
    pairs = zip(frames, (shafts[:2], [], shafts[2:]), strict=True)
    bop = format_of_run("bop")
    rows = read_bop(bop.header + "".join(bop.lines(*pair) for pair in pairs))
    assert [numbers for numbers, *_ in rows] == 2 * [[2, 0, 1]] + 4 * [[2, 2, 1]]
    assert {time for *_, (_, time) in rows} == {-1}  # the same for all shafts of an image
    for (_, rotation, translation, (score, _)), shaft in zip(rows, shafts, strict=True):
        p, w = np.radians([shaft.pose.pitch_deg, shaft.pose.yaw_deg])
        axis = [np.sin(p) * np.cos(w), np.sin(p) * np.sin(w), -np.cos(p)]
        np.testing.assert_allclose(rotation[:, 2], axis, atol=1e-6)
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=3e-6)
        assert np.linalg.det(rotation) == pytest.approx(1)
        np.testing.assert_allclose(translation, shaft.pose.tip_mm, atol=5e-4)
        assert score == pytest.approx(shaft.score, abs=5e-5)


def test_bops_numbers_come_from_names_or_frames() -> None:
    assert BopLines()(Frame("12.png", 0, RGB), [SHAFT]).startswith("1,12,")
    assert BopLines()(Frame("clip.mp4", 7, RGB, 0.28), [SHAFT]).startswith("1,7,")
    with pytest.raises(InputError, match="--format bop needs a number"):
        BopLines()(Frame("frame.png", 0, RGB), [SHAFT])


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (Frame("a.mp4", 0, RGB, 0.28), Frame("b.mp4", 0, RGB, 0.28)),
        (Frame("a/000001.png", 0, RGB), Frame("b/000001.png", 0, RGB)),
        (Frame("x/000003/rgb/000001.png", 0, RGB), Frame("y/000003/rgb/000001.png", 0, RGB)),
        (Frame("a/000001.png", 0, RGB), Frame("b.mp4", 1, RGB, 0.28)),
    ],
)
def test_a_scene_of_bop_has_one_source(first: Frame, second: Frame) -> None:
    lines = BopLines()
    lines(first, [])
    with pytest.raises(InputError, match="--format bop: scene [13] is that of .*predict them one"):
        lines(second, [SHAFT])


def test_images_of_a_folder_and_frames_of_a_video_share_a_scene_of_bop() -> None:
    lines = BopLines()
    for number in (1, 2):
        assert lines(Frame(f"000003/rgb/{number}.png", 0, RGB), [SHAFT]).startswith("3,")
        assert lines(Frame(f"000004/rgb/{number}.png", 0, RGB), [SHAFT]).startswith("4,")
        assert lines(Frame("a.mp4", number, RGB, 0.28), [SHAFT]).startswith("1,")
