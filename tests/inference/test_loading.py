"""A model for a user's frames, in Python."""

import logging
import re
import shutil
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import shaftpose
from shaftpose.core.errors import InputError
from shaftpose.export.onnx_export import store_metadata
from shaftpose.image_files.reading import read_rgb
from shaftpose.inference.loading import load
from shaftpose.inference.model_files import ModelMetadata, model_file
from shaftpose.inference.predictor import Predictor
from tests.inference.test_calibration_files import FILE

ROOT = Path(__file__).parents[2]
FRAME = ROOT / "src/shaftpose/inference/demo_frame.jpg"


def test_what_is_known_is_metric(caplog: pytest.LogCaptureFixture) -> None:
    known = load(view_deg=95.0, diameter_mm=3.0)(read_rgb(FRAME))
    assert not caplog.text
    assert len(known) == 2 and all(shaft.metric for shaft in known)
    thicker = load(view_deg=95.0, diameter_mm=6.0)(read_rgb(FRAME))
    for one, twice in zip(known, thicker, strict=True):
        assert twice.pose.z_mm == pytest.approx(2 * one.pose.z_mm)
        np.testing.assert_allclose(twice.tip_px, one.tip_px)


def test_what_is_unknown_is_said(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        shafts = load()(read_rgb(FRAME))
    assert "MILLIMETRES ARE NOT METRIC" in caplog.text
    assert not any(shaft.metric for shaft in shafts)


def test_a_frame_that_shows_nothing_is_said_once_for_each_source() -> None:
    said: list[str] = []
    find = load(view_deg=95.0, diameter_mm=3.0, warn=said.append)
    black, dim = np.zeros((300, 400, 3), np.uint8), np.zeros((300, 400, 3), np.uint8)
    dim[:20, :20] = 200
    for source in ("a.mp4", "a.mp4", "b.mp4"):
        assert find(black, source) == []
    assert find(dim, "c.png") == []
    assert said == [
        "a.mp4: a frame of 400 x 300 px is all black",
        "b.mp4: a frame of 400 x 300 px is all black",
        "c.png: a frame of 400 x 300 px is dark in more than 95 % of it",
    ]


def test_an_angle_of_frames_with_borders_is_doubted_once() -> None:
    picture = read_rgb(FRAME)
    side = len(picture)
    border = side // 4
    frame = np.pad(picture, ((border, border), (border, border), (0, 0)))
    said: list[str] = []
    find = load(view_deg=95.0, diameter_mm=3.0, warn=said.append)
    for _ in range(2):
        find(frame)
    (warning,) = said
    assert warning.startswith(
        f"frames of {len(frame)} x {len(frame)} px have black borders or dark"
    )
    find(np.pad(picture, ((0, 0), (border, border), (0, 0))))  # it fills the central square
    part = border, border, side, side
    load(view_deg=95.0, diameter_mm=3.0, crop=part, warn=said.append)(frame)
    assert said == [warning]


@pytest.mark.parametrize(("before", "doubted"), [(160, False), (200, True), (0, True)])
def test_an_angle_of_a_picture_beside_the_middle_is_doubted(before: int, doubted: bool) -> None:
    """A full-height picture, with black to its left and right as in recordings with a panel."""
    picture = read_rgb(FRAME)
    said: list[str] = []
    find = load(view_deg=95.0, diameter_mm=3.0, warn=said.append)
    find(np.pad(picture, ((0, 0), (before, 320 - before), (0, 0))))
    assert any("have black borders" in warning for warning in said) is doubted


@pytest.mark.parametrize(
    "frame",
    [np.zeros((300, 400), np.uint8), np.zeros((300, 400, 4), np.uint8), np.zeros((300, 400, 3))],
    ids=["grey", "RGBA", "decimal"],
)
def test_an_array_that_is_no_frame_is_refused(frame: Any) -> None:
    find = load(view_deg=95.0, diameter_mm=3.0)
    with pytest.raises(InputError, match=re.escape(f"{frame.shape} of {frame.dtype}; give height")):
        find(frame)


def test_a_frames_matrix_is_that_of_its_camera(tmp_path: Path) -> None:
    calibration = tmp_path / "cam.yaml"
    calibration.write_text(FILE)
    matrix = load(camera=calibration).camera_matrix(np.zeros((480, 640, 3), dtype=np.uint8))
    # Centres of pixels are at integer + 0.5 here; the distortion fades towards the axis.
    expected = [[500, 0, 321], [0, 510, 239.75], [0, 0, 1]]
    np.testing.assert_allclose(matrix, expected, rtol=1e-3)


def test_a_model_that_is_not_there_is_named() -> None:
    with pytest.raises(InputError, match=r"nowhere\.onnx"):
        load("nowhere.onnx")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"camera": "lens.yml", "view_deg": 70.0}, "camera lens.yml and view_deg 70: give one"),
        ({"view_deg": 180.0}, "view_deg 180: give an angle between 0 and 180"),
        ({"view_deg": float("nan")}, "view_deg nan"),
        ({"diameter_mm": 0.0}, "diameter_mm 0: give a number from 0.001 to 1000"),
        ({"diameter_mm": 1e-300}, "diameter_mm 1e-300: give a number from"),
        ({"diameter_mm": float("inf")}, "diameter_mm inf"),
        ({"score": 1.5}, "score 1.5: give a number from 0 to 1"),
        ({"crop": (0, 0, 400, 0)}, "give x, y, width and height"),
        ({"refine": "edge"}, "refine 'edge': give one of none, mask, edges, views"),
        ({"backend": "tensorrt"}, "backend 'tensorrt': give one of onnxruntime, openvino"),
    ],
)
def test_options_without_a_meaning_are_named(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        load(**options)


@pytest.mark.parametrize("option", [{"view_deg": 95.0}, {"camera": "lens.yml"}])
def test_a_model_of_a_distorting_lens_takes_no_other_camera(
    option: dict[str, Any], constant_model: Path
) -> None:
    store_metadata(constant_model, ModelMetadata(confidence=0.5, distorted=True))
    warnings: list[str] = []
    load(constant_model, warn=warnings.append)
    assert "which none of the options can state" in warnings[0]
    assert "--camera" not in warnings[0]
    with pytest.raises(InputError, match=r"constant\.onnx: was trained with lens distortion"):
        load(constant_model, **option)


def test_a_model_of_a_distorting_lens_sees_squares_by_its_own_camera(tmp_path: Path) -> None:
    path = tmp_path / "distorted.onnx"
    with model_file(None) as bundled:
        shutil.copy(bundled, path)
    store_metadata(path, replace(Predictor(path).metadata, distorted=True))
    predictor, picture = Predictor(path), read_rgb(FRAME)
    side = predictor.side_px
    square = cv2.resize(picture, (side, side), interpolation=cv2.INTER_AREA)
    (evaluated,) = predictor(square[None])
    find = load(path, score=0.5, warn=lambda _: None)
    poses = [shaft.pose.as_array() for shaft in find(square)]
    np.testing.assert_allclose(poses, evaluated.above(0.5).poses, rtol=1e-4)
    wide = cv2.copyMakeBorder(square, 0, 0, 99, 99, cv2.BORDER_REPLICATE)
    np.testing.assert_allclose([one.pose.as_array() for one in find(wide)], poses, rtol=1e-4)


def test_a_model_may_be_a_path() -> None:
    with pytest.raises(InputError, match=r"nowhere\.onnx"):
        load(Path("nowhere.onnx"))


def test_the_readmes_lines_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = re.search(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    assert lines is not None
    large = cv2.resize(cv2.imread(str(FRAME)), (640, 640), interpolation=cv2.INTER_CUBIC)
    cv2.imwrite(str(tmp_path / "frame.png"), large)
    monkeypatch.chdir(tmp_path)
    exec(lines[1], {})
    assert "ShaftPose(" in capsys.readouterr().out


def test_the_package_gives_what_users_need() -> None:
    assert shaftpose.load is load
    assert shaftpose.__version__ == version("shaftpose")
    with pytest.raises(AttributeError, match="has no attribute 'unload'"):
        shaftpose.unload  # noqa: B018
