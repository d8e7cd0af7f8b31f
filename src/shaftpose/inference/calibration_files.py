"""The user's camera: a calibration file of OpenCV or ROS, or a stated view angle."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from shaftpose.core.errors import InputError
from shaftpose.core.geometry import Array
from shaftpose.inference.calibration import Calibration

# The camera of frames of a width and height, whose pixels have an aspect: width / height; raises
# InputError for frames of a wrong size.
FrameCamera = Callable[[int, int, float], Calibration]

# The names of OpenCV's and ROS's programs.
_SIDES = ("image_width", "image_Width", "width"), ("image_height", "image_Height", "height")
_SIZES = ("cameraResolution", "image_size")
_MATRICES = ("camera_matrix", "Camera_Matrix", "cameraMatrix", "K", "k", "M1")
_DISTORTIONS = (
    "distortion_coefficients", "Distortion_Coefficients", "dist_coeffs", "distCoeffs", "D", "d",
    "D1",
)  # fmt: skip
# ROS's names -> whether it is OpenCV's fisheye lens.
_LENSES = {"plumb_bob": False, "rational_polynomial": False, "equidistant": True, "fisheye": True}
_MODEL = "distortion_model"
_FISHEYE = re.compile("fish_?eye|equidistant|kannala", re.IGNORECASE)
_KIND = re.compile("model|type|lens|projection", re.IGNORECASE)  # of entries that name a lens
_COMMENT = re.compile(r"""^([^"'#\n]*)\s#.*$""", re.MULTILINE)
_YES, _NO = ("1", "true", "yes", "on"), ("0", "false", "no", "off")
# Numbers of coefficients in OpenCV's models of distortion; 0: a pinhole.
_COEFFICIENTS, _OF_FISHEYE = (0, 4, 5, 8, 12, 14), (4,)

# OpenCV's parsers die of files that are nested deeply; each level has one of these.
_MOST_CHARACTERS, _MOST_LEVELS, _LEVEL = 2_000_000, 2_000, ("[", "{", "<", ":", "- ")
_MOST_TANGENTIAL = 0.02  # p1 and p2 of a lens; mounted well, they are far smaller
_OFF_CENTRE = 0.1  # of a side: a principal point farther from the middle belongs to another size
_USUAL_PX = 1000  # side of a frame in which an angle is checked


def stated_view(view_deg: float) -> FrameCamera:
    """A centred camera without distortion for frames of any size, with this angle across their
    central square. Raises InputError if no camera has it."""

    Calibration.pinhole(_USUAL_PX, _USUAL_PX, view_deg).check()

    def camera(width: int, height: int, aspect: float) -> Calibration:
        return Calibration.pinhole(width, height, view_deg, aspect)

    return camera


@dataclass(frozen=True)
class CameraFile:
    """A camera as a file states it: a `FrameCamera` for frames of its size alone.

    size: width and height; None if the file states none. matrix, distortion, fisheye: see
    `Calibration`.
    """

    path: Path
    size: tuple[int, int] | None
    matrix: Array
    distortion: Array
    fisheye: bool

    @property
    def centre(self) -> Array:
        """The principal point (2,) px; centres of pixels are at integer + 0.5."""
        return np.asarray(self.matrix[:2, 2] + 0.5)

    def is_centred(self, width: int, height: int) -> bool:
        """Whether the principal point is near the middle of frames of this size."""
        return bool(np.all(np.abs(self.centre / [width, height] - 0.5) <= _OFF_CENTRE))

    def __call__(self, width: int, height: int, aspect: float = 1.0) -> Calibration:
        """The camera of frames, which knows the aspect of its pixels by itself. Raises InputError
        if it has another size, or cannot have taken them."""
        if self.size is None and not self.is_centred(width, height):
            raise InputError(
                f"has {width} x {height} px, but the principal point in {self.path} is "
                f"{self.centre.tolist()} px; add the image_width and image_height of its frames"
            )
        if self.size not in (None, (width, height)):
            raise InputError(
                "has {} x {} px, but {} is the calibration of {} x {} px; calibrate for these "
                "frames or, for a part of frames, change the size and principal point in "
                "the file".format(width, height, self.path, *self.size or ())
            )
        calibration = Calibration(width, height, self.matrix, self.distortion, self.fisheye)
        try:
            calibration.check()
        except InputError as error:
            raise InputError(f"{self.path}: {error}") from error
        return calibration


def read_camera(path: Path, warn: Callable[[str], None]) -> CameraFile:
    """Read a YAML, XML or JSON file as OpenCV's and ROS's calibration programs write it; of a
    stereo camera, the first eye.

    Raises InputError naming the file and the faulty entry.
    """
    try:
        camera, notes = _camera_in(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    except (UnicodeDecodeError, SystemError, cv2.error) as error:
        raise _no_calibration(path) from error
    for note in notes:
        warn(f"{path}: {note}")
    if camera.size is not None:
        camera(*camera.size)
        if not camera.is_centred(*camera.size):  # as for a part of frames it may be
            warn(
                f"{path}: its principal point is {camera.centre.tolist()} px, far from the middle "
                "of {} x {} px: was it calibrated at another size?".format(*camera.size)
            )
    return camera


def _camera_in(path: Path) -> tuple[CameraFile, list[str]]:
    """The camera in a file, and doubts about it. Raises OpenCV's exceptions, too."""
    storage = _opened(path)
    fisheye = _is_fisheye(path, storage)
    matrix = _numbers(path, storage, _MATRICES, (9,)).reshape(3, 3)
    if not _is_camera(matrix):
        raise InputError(
            f"{path}: camera_matrix: must be [fx, 0, cx, 0, fy, cy, 0, 0, 1] in px, is "
            f"{matrix.ravel().tolist()}"
        )
    distortion = _numbers(path, storage, _DISTORTIONS, _OF_FISHEYE if fisheye else _COEFFICIENTS)
    camera = CameraFile(path, _size(path, storage), matrix, distortion, fisheye)
    notes = []
    if not storage.getNode("M2").empty():
        notes.append("holds two cameras: the first one, M1 and D1, is taken for all frames")
    names = list(storage.root().keys())
    stated = fisheye or any(name == _MODEL or _FISHEYE.search(name) for name in names)
    tangential = distortion[2:] if len(distortion) in _OF_FISHEYE and not stated else np.zeros(2)
    if np.abs(tangential).max() > _MOST_TANGENTIAL:
        notes.append(
            f"its last coefficients of distortion, {tangential.tolist()}, are taken for p1 and p2, "
            "and are large for them: if they are k3 and k4 of a fisheye lens, add fisheye_model: 1"
        )
    return camera, notes


def _opened(path: Path) -> cv2.FileStorage:
    if path.exists() and not path.is_file():  # a pipe may never end
        raise InputError(f"{path}: no file; name a calibration file")
    with path.open(encoding="utf-8-sig") as file:
        text = file.read(_MOST_CHARACTERS + 1)
    if len(text) > _MOST_CHARACTERS or max(map(text.count, _LEVEL)) > _MOST_LEVELS:
        raise InputError(f"{path}: no calibration file: it is too large, or nested too deeply")
    if not text.startswith(("<?xml", "{")):  # OpenCV's parser wants no comments after values
        text = _COMMENT.sub(r"\1", text)
    if not text.startswith(("%YAML", "<?xml", "{")):  # ROS's YAML
        # `rostopic echo` ends each of its messages by a line of dashes.
        message = re.split("^---", text.strip().removeprefix("---"), flags=re.MULTILINE)[0]
        # OpenCV's parser wants the items of a list farther in than its name; `ros2 topic echo` and
        # PyYAML write both in one column.
        message = re.sub("^( *)- ", r"\1  - ", message, flags=re.MULTILINE)
        text = f"%YAML:1.0\n---\n{message}\n"
    storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
    if not storage.root().isMap():
        raise _no_calibration(path)
    return storage


def _no_calibration(path: Path) -> InputError:
    return InputError(
        f"{path}: no calibration file; name one that a program of OpenCV or ROS has written"
    )


def _is_fisheye(path: Path, storage: cv2.FileStorage) -> bool:
    """Whether any entry tells of a fisheye lens: programs have several words for it."""
    stated = _value(storage, _MODEL).lower()
    remedy = f"calibrate with one of {', '.join(_LENSES)}"
    if not storage.getNode("xi").empty():
        raise InputError(f"{path}: xi: an omnidirectional lens is not supported; {remedy}")
    known = _LENSES.get(stated, bool(_FISHEYE.search(stated)))
    if stated not in ("", *_LENSES) and not known:
        raise InputError(f"{path}: {_MODEL}: {stated} is not supported; {remedy}")
    found = known
    for name in list(storage.root().keys()):
        value = _value(storage, name).lower()
        if _FISHEYE.search(name):
            if value not in (*_YES, *_NO):
                raise InputError(f"{path}: {name}: {value}: must be 1 or 0")
            found = found or value in _YES
        elif _KIND.search(name):
            found = found or bool(_FISHEYE.search(value))
    if found and stated in _LENSES and not known:
        raise InputError(
            f"{path}: {_MODEL}: {stated} is no fisheye lens, another entry is; {remedy}"
        )
    return found


def _value(storage: cv2.FileStorage, name: str) -> str:
    """A text or a number as text; "" if it is not there, "a list" for what has parts."""
    node = storage.getNode(name)
    if node.isString():
        return str(node.string())
    if node.isInt() or node.isReal():
        return f"{node.real():g}"
    return "" if node.empty() else "a list"


def _size(path: Path, storage: cv2.FileStorage) -> tuple[int, int] | None:
    both = _first(storage, _SIZES)
    sides = [_first(storage, names) for names in _SIDES]
    if both.isSeq() and both.size() == 2:
        sides = [both.at(0), both.at(1)]
    if all(side.empty() for side in sides):
        return None
    if not all(side.isInt() and side.real() >= 1 for side in sides):
        raise InputError(f"{path}: image_width, image_height: must be two whole numbers above 0")
    width, height = (int(side.real()) for side in sides)
    return width, height


def _first(storage: cv2.FileStorage, names: Sequence[str]) -> cv2.FileNode:
    """The first node of these names that is there; else an empty one."""
    nodes = [storage.getNode(name) for name in names]
    return next((node for node in nodes if not node.empty()), nodes[0])


def _numbers(
    path: Path, storage: cv2.FileStorage, names: Sequence[str], counts: Sequence[int]
) -> Array:
    """The numbers of a matrix, row by row. OpenCV 4.11's own `mat()` misreads whole numbers without
    a decimal point (opencv-python's issue 1078)."""
    node = _first(storage, names)
    data = node.getNode("data") if node.isMap() else node
    count = data.size() if data.isSeq() else -1
    if count not in counts:
        raise InputError(
            f"{path}: {names[0]}: missing, or not a matrix of {' or '.join(map(str, counts))} "
            "numbers; write it by cv2.FileStorage, as docs/prediction.md shows"
        )
    items = [data.at(place) for place in range(count)]
    numbers = np.array([item.real() for item in items], dtype=np.float64)
    if not all(item.isInt() or item.isReal() for item in items) or not np.isfinite(numbers).all():
        raise InputError(
            f"{path}: {names[0]}: holds a value that is not a finite number; calibrate again"
        )
    return numbers


def _is_camera(matrix: Array) -> bool:
    """Whether a matrix (3, 3) has positive focal lengths and no skew, which OpenCV would ignore."""
    shape = np.array([[1, 0, 1], [0, 1, 1], [0, 0, 1]])
    return bool(min(matrix[0, 0], matrix[1, 1]) > 0 and not matrix[shape == 0].any()
                and matrix[2, 2] == 1)  # fmt: skip
