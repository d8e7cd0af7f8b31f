"""A user's camera from OpenCV's calibration file, or from a stated view angle."""

import os
import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from shaftpose.core.errors import InputError
from shaftpose.inference.calibration_files import CameraFile, read_camera, stated_view

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
   data: [ -2.5e-01, 1, 0, 0., 0.125 ]
"""

PINHOLE = """%YAML:1.0
---
image_width: 640
image_height: 480
camera_matrix: {rows: 3, cols: 3, dt: d, data: [240, 0, 319.5, 0, 240, 239.5, 0, 0, 1]}
distortion_coefficients: {rows: 5, cols: 1, dt: d, data: [0, 0, 0, 0, 0]}
"""


ROS = """image_width: 640
image_height: 480
camera_name: endoscope
camera_matrix:
  rows: 3
  cols: 3
  data: [240.0, 0.0, 319.5, 0.0, 240.0, 239.5, 0.0, 0.0, 1.0]
distortion_model: equidistant
distortion_coefficients:
  rows: 1
  cols: 4
  data: [-0.02, 0.01, -0.004, 0.001]
projection_matrix:
  rows: 3
  cols: 4
  data: [1000.0, 0.0, 959.5, 0.0, 0.0, 1000.0, 539.5, 0.0, 0.0, 0.0, 1.0, 0.0]
"""
MATRIX = np.array([[500, 0, 320], [0, 510, 240], [0, 0, 1.0]])


def fail(message: str) -> None:
    raise AssertionError(message)


def read(path: Path) -> CameraFile:
    return read_camera(path, fail)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "cam.yaml"


def test_a_calibration_is_read(path: Path) -> None:
    """Whole numbers without a point, as a person may write them, too."""
    path.write_text(FILE)
    camera = read(path)
    assert camera.size == (640, 480)
    assert camera.matrix.tolist() == [[500, 0, 320.5], [0, 510, 239.25], [0, 0, 1]]
    assert camera.distortion.tolist() == [-0.25, 1, 0, 0, 0.125]


@pytest.mark.parametrize("suffix", ["yaml", "xml", "json"])
def test_what_opencv_writes_is_read(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"cam.{suffix}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 640)
    storage.write("image_height", 480)
    storage.write("camera_matrix", np.array([[500, 0, 320], [0, 500, 240], [0, 0, 1.0]]))
    storage.write("distortion_coefficients", np.array([[0.1, 0, 0, 0]]))
    storage.release()
    camera = read(path)
    assert camera.matrix[0].tolist() == [500, 0, 320]
    assert camera.distortion.tolist() == [0.1, 0, 0, 0]


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        (FILE, "", "no calibration file"),
        (FILE, "camera: [", "no calibration file"),
        ("640", "wide", "image_width, image_height: must be two whole numbers above 0"),
        ("480", "0", "image_width, image_height: must be two whole numbers above 0"),
        ("image_height: 480", "", "image_width, image_height: must be"),
        ("camera_matrix", "camera", "camera_matrix: missing, or not a matrix of 9 numbers"),
        ("0.125", "much", "distortion_coefficients: holds a value"),
        ("0.125", ".Nan", "distortion_coefficients: holds a value"),
        (", 0., 0.125", "", "distortion_coefficients: .*of 0 or 4 or 5 or 8"),
        ("500.", "-500.", "camera_matrix: must be"),
        ("0., 320.5", "2., 320.5", "camera_matrix: must be"),
        ("---", "---\nfisheye_model: 1", "distortion_coefficients: .*a matrix of 4 numbers"),
        ("---", "---\ndistortion_model: thin_prism", "distortion_model: thin_prism is not"),
        ("---", "---\ndistortion_model: 3", "distortion_model: "),
        ("320.5", "720.5", "the camera's principal point"),
        ("510.", "51.", "focal lengths of 500 and 51 px are not those of one lens"),
        ("rows: 3", f"{'9' * 40}: 3", "no calibration file"),
        ("-2.5e-01", "9" * 40, "(no calibration file|without lens distortion, 0 x 0 px)"),
        (FILE, "[1, 2]", "no calibration file"),
        (FILE, "%YAML:1.0\n---\n- 1\n- 2\n", "no calibration file"),
        (FILE, "%YAML:1.0\n---\na: " + "[" * 100_000, "no calibration file: it is too large, or"),
        (FILE, "%YAML:1.0\n---\na:\n   " + "- " * 100_000 + "1", "no calibration file: it is"),
        (FILE, "<?xml version='1.0'?>\n" + "<a>" * 100_000, "no calibration file: it is"),
        (FILE, '{"a":' * 100_000 + "1" + "}" * 100_000, "no calibration file: it is"),
        ("-2.5e-01", "1, " * 100_000 + "1", "distortion_coefficients: .* not a matrix of 0 or 4"),
        ("---", "---\n#" + "x" * 2_000_000, "no calibration file: it is too large"),
    ],
)
def test_what_is_wrong_is_named(path: Path, old: str, new: str, complaint: str) -> None:
    path.write_text(FILE.replace(old, new))
    with pytest.raises(InputError, match=f"^{path}: {complaint}"):
        read(path)


@pytest.mark.parametrize(
    "names",
    [
        ("image_width", "image_height", "camera_matrix", "distortion_coefficients"),
        ("image_Width", "image_Height", "Camera_Matrix", "Distortion_Coefficients"),
        ("cameraResolution", "cameraMatrix", "dist_coeffs"),
    ],
)
def test_the_names_of_opencvs_programs_are_read(names: tuple[str, ...], tmp_path: Path) -> None:
    path = tmp_path / "cam.xml"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    *sizes, matrix, distortion = names
    if len(sizes) == 1:
        storage.startWriteStruct(sizes[0], cv2.FileNode_SEQ)
        storage.write("", 640)
        storage.write("", 480)
        storage.endWriteStruct()
    else:
        storage.write(sizes[0], 640)
        storage.write(sizes[1], 480)
    storage.write(matrix, MATRIX)
    storage.write(distortion, np.array([[0.1, 0, 0, 0, 0.2]]))
    storage.release()
    camera = read(path)
    assert (camera.size, camera.fisheye) == ((640, 480), False)
    assert camera.distortion.tolist() == [0.1, 0, 0, 0, 0.2]


def test_the_first_eye_of_a_stereo_camera_is_taken_for_frames_around_its_axis(path: Path) -> None:
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in (("M1", MATRIX), ("D1", np.zeros((1, 5))), ("M2", MATRIX)):
        storage.write(name, value)
    storage.release()
    said: list[str] = []
    camera = read_camera(path, said.append)
    assert said == [f"{path}: holds two cameras: the first one, M1 and D1, is taken for all frames"]
    assert camera(640, 480).matrix.tolist() == MATRIX.tolist()
    for size in ((1280, 480), (960, 720)):  # twice as wide; 1.5 times as large
        with pytest.raises(InputError, match=f"has {size[0]} x {size[1]} px, but the principal"):
            camera(*size)


def test_a_principal_point_of_another_size_is_doubted(path: Path) -> None:
    path.write_text(PINHOLE.replace("640", "1280").replace("480", "960"))
    said: list[str] = []
    assert read_camera(path, said.append)(1280, 960).width == 1280
    assert said == [
        f"{path}: its principal point is [320.0, 240.0] px, far from the middle of 1280 x 960 px: "
        "was it calibrated at another size?"
    ]


@pytest.mark.parametrize(
    ("model", "fisheye"),
    [("equidistant", True), ("fisheye", True), ("plumb_bob", False), ('"plumb_bob"', False),
     ("rational_polynomial", False)],
)  # fmt: skip
def test_ros_names_the_lens(model: str, fisheye: bool, path: Path) -> None:
    path.write_text(ROS.replace("equidistant", model))
    camera = read(path)
    assert (camera.size, camera.fisheye) == ((640, 480), fisheye)
    assert camera(640, 480).fisheye is fisheye


# As `rostopic echo /camera_info` prints it.
MESSAGE = """header:
  frame_id: "endoscope"
height: 480
width: 640
distortion_model: "plumb_bob"
D: [-0.25, 1.0, 0.0, 0.0, 0.125]
K: [500.0, 0.0, 320.5, 0.0, 510.0, 239.25, 0.0, 0.0, 1.0]
roi:
  height: 0
  width: 0
---
"""


def ros_2(message: str) -> str:
    """The message as `ros2 topic echo` prints it: in lower case, an item of a list in each line."""

    def lines(found: re.Match[str]) -> str:
        return f"{found[1].lower()}:\n- " + "\n- ".join(found[2].split(", "))

    return re.sub(r"^([DK]): \[(.*)\]", lines, message, flags=re.MULTILINE)


COMMENTED = re.sub("([^-])$", r"\1 # note", MESSAGE, flags=re.MULTILINE)


@pytest.mark.parametrize("text", [MESSAGE, ros_2(MESSAGE), 3 * MESSAGE, COMMENTED])
@pytest.mark.parametrize("begin", ["", "---\n", "\ufeff"])
def test_a_message_of_ros_is_read(begin: str, text: str, path: Path) -> None:
    path.write_text(begin + text, encoding="utf-8")
    camera = read(path)
    assert camera.size == (640, 480)
    assert camera.matrix.tolist() == [[500, 0, 320.5], [0, 510, 239.25], [0, 0, 1]]
    assert camera.distortion.tolist() == [-0.25, 1, 0, 0, 0.125]


def test_a_pipe_is_refused(tmp_path: Path) -> None:
    pipe = tmp_path / "cam.yaml"
    os.mkfifo(pipe)
    with pytest.raises(InputError, match=r"cam\.yaml: no file"):
        read(pipe)


def test_opencvs_fisheye_lens_is_read(path: Path) -> None:
    marked = FILE.replace("---", "---\nfisheye_model: 1").replace(" 1, 0, 0., 0.125", " 0.1, 0, 0.")
    path.write_text(marked)
    assert read(path).fisheye
    path.write_text(marked.replace("fisheye_model: 1", "fisheye_model: 0"))
    assert not read(path).fisheye


@pytest.mark.parametrize(
    ("line", "fisheye"),
    [("fisheye_model: true", True), ("fisheye_model: Yes", True), ('fisheye_model: "1"', True),
     ("fisheye_model: 1.0", True), ("fisheye: 1", True), ("camera_model: Fisheye", True),
     ("is_fisheye: 1", True), ("lens_model: KANNALA_BRANDT", True), ("camera_name: fisheye", False),
     ("distortion_type: equidistant", True), ("distortion_model: Fisheye", True),
     ("fisheye_model: false", False), ("fisheye: no", False), ("camera_model: pinhole", False)],
)  # fmt: skip
def test_a_fisheye_lens_is_known_in_other_words(line: str, fisheye: bool, path: Path) -> None:
    path.write_text(FILE.replace("---", f"---\n{line}").replace(" 1, 0, 0., 0.125", " 0.1, 0, 0."))
    assert read(path).fisheye is fisheye


@pytest.mark.parametrize(
    ("coefficients", "said", "large"),
    [
        ("-0.02, 0.1, -0.14, 0.08", "", "-0.14, 0.08"),
        ("-0.02, 0.1, -0.14, 0.08", "distortion_model: plumb_bob\n", ""),
        ("-0.02, 0.1, -0.14, 0.08", "fisheye_model: 0\n", ""),
        ("-0.3, 0.1, 0.004, -0.02", "", ""),
        ("-0.3, 0.1, 0.1, 0.1, 0.3", "", ""),
    ],
)
def test_coefficients_that_may_be_a_fisheye_lens_are_doubted(
    coefficients: str, said: str, large: str, tmp_path: Path
) -> None:
    path, warnings = tmp_path / "camera.yml", list[str]()
    count = coefficients.count(",") + 1
    file = PINHOLE.replace("rows: 5", f"rows: {count}").replace("0, 0, 0, 0, 0", coefficients)
    path.write_text(file + said)
    read_camera(path, warnings.append)
    assert warnings == (
        [f"{path}: its last coefficients of distortion, [{large}], are taken for p1 and p2, and "
         "are large for them: if they are k3 and k4 of a fisheye lens, add fisheye_model: 1"]
        if large else []
    )  # fmt: skip


@pytest.mark.parametrize(
    ("line", "complaint"),
    [("fisheye_model: 2", "fisheye_model: 2: must be 1 or 0"),
     ("fisheye: perhaps", "fisheye: perhaps: must be 1 or 0"),
     ("distortion_model: 1", "distortion_model: 1 is not supported"),
     ("distortion_model: [1]", "distortion_model: a list is not supported"),
     ("xi: 1.2", "xi: an omnidirectional lens is not supported")],
)  # fmt: skip
def test_an_unknown_lens_is_refused(line: str, complaint: str, path: Path) -> None:
    path.write_text(FILE.replace("---", f"---\n{line}"))
    with pytest.raises(InputError, match=f"^{path}: {re.escape(complaint)}"):
        read(path)


def test_a_missing_file_and_a_picture_are_named(path: Path) -> None:
    with pytest.raises(InputError, match=f"^{path}: cannot be read"):
        read(path)
    path.write_bytes(b"\x89PNG\xff\x00")
    with pytest.raises(InputError, match=f"^{path}: no calibration file"):
        read(path)


def test_a_calibration_is_for_frames_of_its_own_size(tmp_path: Path) -> None:
    path = tmp_path / "cam.yaml"
    path.write_text(FILE)
    camera = read(path)
    assert camera(640, 480).matrix[0, 0] == 500
    for width, height in ((1280, 960), (480, 640), (640, 360)):
        with pytest.raises(InputError, match=f"has {width} x {height} px, .* of 640 x 480 px"):
            camera(width, height)


def test_an_angle_that_no_camera_has_is_named() -> None:
    with pytest.raises(InputError, match="a focal length of .* px is not that of frames"):
        stated_view(1e-5)(640, 480, 1.0)


def test_a_stated_view_is_that_of_the_central_square() -> None:
    """At 90 deg the focal length is half of the shorter side."""
    camera = stated_view(90.0)(1920, 1080, 1.0)
    assert camera.matrix == pytest.approx(np.array([[540, 0, 959.5], [0, 540, 539.5], [0, 0, 1]]))
