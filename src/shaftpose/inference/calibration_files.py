"""The user's camera: a calibration file of OpenCV, or a stated view angle."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from shaftpose.core.errors import InputError
from shaftpose.core.geometry import Array
from shaftpose.inference.calibration import Calibration

# The camera of frames of a width and height; raises InputError for frames of a wrong size.
FrameCamera = Callable[[int, int], Calibration]

# Numbers of coefficients in OpenCV's models of distortion; 0: a pinhole.
_COEFFICIENTS = (0, 4, 5, 8, 12, 14)


def stated_view(view_deg: float) -> FrameCamera:
    """A centred camera without distortion for frames of any size, with this angle across their
    central square."""
    return lambda width, height: Calibration.pinhole(width, height, view_deg)


def calibrated(path: Path) -> FrameCamera:
    """The camera in a calibration file, for frames of its size alone.

    Raises InputError naming the file if it is not a calibration.
    """
    calibration = read_calibration(path)

    def camera(width: int, height: int) -> Calibration:
        if (width, height) != (calibration.width, calibration.height):
            raise InputError(
                f"has {width} x {height} px, but {path} is the calibration of "
                f"{calibration.width} x {calibration.height} px; calibrate for these frames"
            )
        return calibration

    return camera


def read_calibration(path: Path) -> Calibration:
    """Read `image_width`, `image_height`, `camera_matrix` and `distortion_coefficients` from a
    YAML, XML or JSON file, as OpenCV's calibration programs write them.

    Raises InputError naming the file and the faulty entry.
    """
    storage = _opened(path)
    width, height = (_whole(path, storage, f"image_{side}") for side in ("width", "height"))
    if _given(storage.getNode("fisheye_model")):
        raise InputError(f"{path}: fisheye_model: calibrate with OpenCV's other lens model")
    matrix = _numbers(path, storage, "camera_matrix")
    distortion = _numbers(path, storage, "distortion_coefficients")
    if matrix.size != 9 or not _is_camera(matrix.reshape(3, 3)):
        raise InputError(
            f"{path}: camera_matrix: must be [fx, 0, cx, 0, fy, cy, 0, 0, 1] in px, is "
            f"{matrix.tolist()}"
        )
    if distortion.size not in _COEFFICIENTS:
        raise InputError(
            f"{path}: distortion_coefficients: {distortion.size} numbers; OpenCV has "
            f"{', '.join(map(str, _COEFFICIENTS))}"
        )
    return Calibration(width, height, matrix.reshape(3, 3), distortion)


def _opened(path: Path) -> cv2.FileStorage:
    try:
        text = path.read_text()
        return cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    except (UnicodeDecodeError, SystemError, cv2.error) as error:
        raise InputError(
            f"{path}: no calibration file; OpenCV's YAML begins with %YAML:1.0"
        ) from error


def _whole(path: Path, storage: cv2.FileStorage, name: str) -> int:
    node = storage.getNode(name)
    if not node.isInt() or node.real() < 1:
        raise InputError(f"{path}: {name}: missing or not a whole number above 0")
    return int(node.real())


def _numbers(path: Path, storage: cv2.FileStorage, name: str) -> Array:
    """The numbers of a matrix, row by row. OpenCV 4.11's own `mat()` misreads whole numbers without
    a decimal point (opencv-python's issue 1078)."""
    node = storage.getNode(name)
    data = node.getNode("data") if node.isMap() else node
    items = [data.at(place) for place in range(data.size())] if data.isSeq() else []
    if not data.isSeq() or not all(item.isInt() or item.isReal() for item in items):
        raise InputError(f"{path}: {name}: missing or not a matrix of numbers")
    numbers = np.array([item.real() for item in items], dtype=np.float64)
    if not np.isfinite(numbers).all():
        raise InputError(f"{path}: {name}: holds a value that is not finite; calibrate again")
    return numbers


def _given(node: cv2.FileNode) -> bool:
    return bool(node.isInt() and node.real())


def _is_camera(matrix: Array) -> bool:
    """Whether a matrix (3, 3) has positive focal lengths and no skew, which OpenCV would ignore."""
    shape = np.array([[1, 0, 1], [0, 1, 1], [0, 0, 1]])
    return bool(min(matrix[0, 0], matrix[1, 1]) > 0 and not matrix[shape == 0].any()
                and matrix[2, 2] == 1)  # fmt: skip
