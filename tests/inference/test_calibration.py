"""A user's camera from OpenCV's calibration file."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from shaftpose.core.errors import InputError
from shaftpose.inference.calibration import Calibration, read_calibration

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
        ("0.125", ".Nan", "distortion_coefficients: holds what is no number"),
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


def test_rays_become_pixels() -> None:
    """400 x 300 px and 90 deg across 300 px: the focal length is 150 px, the middle (200, 150)."""
    rays = np.array([[0, 0], [0.5, 0], [0.5, -0.2]])
    plain = Calibration.pinhole(400, 300, 90.0)
    assert plain.image_px(rays).tolist() == pytest.approx(
        np.array([[200, 150], [275, 150], [275, 120]])
    )
    # k1 = 0.1 at r = 0.5 stretches by 1.025, p1 = 0.01 moves by 0.01 r^2 along y.
    bent = Calibration(400, 300, plain.matrix, np.array([0.1, 0, 0.01, 0]))
    assert bent.image_px(rays[1:2])[0] == pytest.approx([276.875, 150.375])


def test_rays_beyond_the_fold_of_a_distortion_are_moved_to_it() -> None:
    """r (1 - 0.1 r^2) grows up to r = sqrt(10 / 3) = 1.826, where it is 1.217."""
    plain = Calibration.pinhole(400, 300, 90.0)
    assert plain.valid_radius == np.inf
    barrel = Calibration(400, 300, plain.matrix, np.array([-0.1, 0, 0, 0]))
    assert barrel.valid_radius == pytest.approx(1.826, abs=2e-3)
    assert barrel.image_px(np.array([[0.0, 5.0]]))[0] == pytest.approx(
        [200, 150 + 150 * 1.217], abs=0.1
    )


@pytest.mark.parametrize("view_deg", [60.0, 95.0, 120.0])
def test_a_centred_pinhole_sees_the_whole_of_its_square(view_deg: float) -> None:
    camera = Calibration.pinhole(640, 480, view_deg)
    assert camera.widest_view_deg() == pytest.approx(view_deg, abs=0.02)


def test_an_axis_off_the_centre_narrows_the_view() -> None:
    """The nearest border is 100 px from the axis: an angle of 2 atan(100 / 200)."""
    matrix = np.array([[200.0, 0, 99.5], [0, 200, 239.5], [0, 0, 1]])
    camera = Calibration(640, 480, matrix, np.zeros(0))
    assert camera.widest_view_deg() == pytest.approx(53.13, abs=0.02)


def test_barrel_distortion_widens_the_view() -> None:
    """The middle of a side is distorted less than its ends, and leaves the frame first: where
    f t (1 + k1 t^2) is half of the side."""
    matrix = np.array([[400.0, 0, 239.5], [0, 400, 239.5], [0, 0, 1]])
    camera = Calibration(480, 480, matrix, np.array([-0.1, 0, 0, 0]))
    tangent = np.tan(np.radians(camera.widest_view_deg() / 2))
    assert tangent * (1 - 0.1 * tangent**2) == pytest.approx(240 / 400, abs=2e-4)
