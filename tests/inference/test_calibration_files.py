"""A user's camera from OpenCV's calibration file, or from a stated view angle."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from shaftpose.core.errors import InputError
from shaftpose.inference.calibration_files import calibrated, read_calibration, stated_view

FILE = """%YAML:1.0
---
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 500., 0., 320.5, 0., 510., 239.25, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -2.5e-01, 0, 1, 0., 0.125 ]
"""

PINHOLE = """%YAML:1.0
---
image_width: 640
image_height: 480
camera_matrix: {rows: 3, cols: 3, dt: d, data: [240, 0, 319.5, 0, 240, 239.5, 0, 0, 1]}
distortion_coefficients: {rows: 5, cols: 1, dt: d, data: [0, 0, 0, 0, 0]}
"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "cam.yaml"


def test_a_calibration_is_read(path: Path) -> None:
    """Whole numbers without a point, as a person may write them, too."""
    path.write_text(FILE)
    camera = read_calibration(path)
    assert (camera.width, camera.height) == (640, 480)
    assert camera.matrix.tolist() == [[500, 0, 320.5], [0, 510, 239.25], [0, 0, 1]]
    assert camera.distortion.tolist() == [-0.25, 0, 1, 0, 0.125]


@pytest.mark.parametrize("suffix", ["yaml", "xml", "json"])
def test_what_opencv_writes_is_read(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"cam.{suffix}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 640)
    storage.write("image_height", 480)
    storage.write("camera_matrix", np.array([[500, 0, 320], [0, 500, 240], [0, 0, 1.0]]))
    storage.write("distortion_coefficients", np.array([[0.1, 0, 0, 0]]))
    storage.release()
    camera = read_calibration(path)
    assert camera.matrix[0].tolist() == [500, 0, 320]
    assert camera.distortion.tolist() == [0.1, 0, 0, 0]


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        (FILE, "", "no calibration file"),
        (FILE, "camera: [", "no calibration file"),
        ("640", "wide", "image_width: missing or not a whole number above 0"),
        ("480", "0", "image_height: missing or not a whole number above 0"),
        ("camera_matrix", "K", "camera_matrix: missing or not a matrix"),
        ("0.125", "much", "distortion_coefficients: missing or not a matrix"),
        ("0.125", ".Nan", "distortion_coefficients: holds a value that is not finite"),
        (", 0., 0.125", "", "distortion_coefficients: 3 numbers"),
        ("500.", "-500.", "camera_matrix: must be"),
        ("0., 320.5", "2., 320.5", "camera_matrix: must be"),
        ("---", "---\nfisheye_model: 1", "fisheye_model"),
    ],
)
def test_what_is_wrong_is_named(path: Path, old: str, new: str, complaint: str) -> None:
    path.write_text(FILE.replace(old, new))
    with pytest.raises(InputError, match=f"^{path}: {complaint}"):
        read_calibration(path)


def test_a_missing_file_and_a_picture_are_named(path: Path) -> None:
    with pytest.raises(InputError, match=f"^{path}: cannot be read"):
        read_calibration(path)
    path.write_bytes(b"\x89PNG\xff\x00")
    with pytest.raises(InputError, match=f"^{path}: no calibration file"):
        read_calibration(path)


def test_a_calibration_is_for_frames_of_its_own_size(tmp_path: Path) -> None:
    path = tmp_path / "cam.yaml"
    path.write_text(FILE)
    camera = calibrated(path)
    assert camera(640, 480).matrix[0, 0] == 500
    for width, height in ((1280, 960), (480, 640), (640, 360)):
        with pytest.raises(InputError, match=f"has {width} x {height} px, .* of 640 x 480 px"):
            camera(width, height)


def test_a_stated_view_is_that_of_the_central_square() -> None:
    """At 90 deg the focal length is half of the shorter side."""
    camera = stated_view(90.0)(1920, 1080)
    assert camera.matrix == pytest.approx(np.array([[540, 0, 959.5], [0, 540, 539.5], [0, 0, 1]]))
