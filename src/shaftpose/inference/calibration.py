"""A user's camera as OpenCV describes it: intrinsics and lens distortion."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.core.errors import InputError

Array = NDArray[np.float64]

# Numbers of coefficients in OpenCV's models of distortion; 0: a pinhole.
_COEFFICIENTS = (0, 4, 5, 8, 12, 14)
_BORDER_RAYS = 101  # on each side of a square
_TANGENT_STEP = 1e-4
_WIDEST_TANGENT = 10.0  # rays farther from the optical axis than 84 deg are never asked for


@dataclass(frozen=True)
class Calibration:
    """A camera.

    matrix: (3, 3), px, for pixel centres at whole numbers, as OpenCV has them; distortion: (D,),
    k1, k2, p1, p2, k3, ... of `cv2.projectPoints`.
    """

    width: int
    height: int
    matrix: Array
    distortion: Array

    @classmethod
    def pinhole(cls, width: int, height: int, view_deg: float) -> "Calibration":
        """A centred camera without distortion; view_deg: the angle across the central square."""
        focal_px = min(width, height) / (2 * np.tan(np.radians(view_deg) / 2))
        matrix = [[focal_px, 0, (width - 1) / 2], [0, focal_px, (height - 1) / 2], [0, 0, 1]]
        return cls(width, height, np.array(matrix), np.zeros(0))

    def image_px(self, rays: Array) -> Array:
        """Pixels (N, 2), centres at integer + 0.5, of rays (N, 2): x / z and y / z.

        Rays beyond the lens's valid radius are moved to it.
        """
        radius = np.linalg.norm(rays, axis=1, keepdims=True)
        followed = rays * np.minimum(1, self.valid_radius / np.maximum(radius, 1e-12))
        points = np.column_stack([followed, np.ones(len(rays))])
        pixels, _ = cv2.projectPoints(
            points, np.zeros(3), np.zeros(3), self.matrix, self.distortion
        )
        return np.asarray(pixels[:, 0] + 0.5, dtype=np.float64)

    def widest_view_deg(self) -> float:
        """The angle across the widest square that a camera without distortion, looking the same
        way, could see in the frame."""
        along, beside = np.linspace(-1, 1, _BORDER_RAYS), np.ones(_BORDER_RAYS)
        sides = ((along, beside), (along, -beside), (beside, along), (-beside, along))
        border = np.concatenate([np.column_stack(side) for side in sides])
        low, high = 0.0, _WIDEST_TANGENT
        while high - low > _TANGENT_STEP:
            middle = (low + high) / 2
            low, high = (middle, high) if self._sees(middle * border) else (low, middle)
        return float(np.degrees(2 * np.arctan(low)))

    def _sees(self, rays: Array) -> bool:
        """Whether the rays (N, 2) all lie in the frame."""
        pixels, size = self.image_px(rays), np.array([self.width, self.height])
        inside = np.all((pixels >= 0) & (pixels <= size))
        return bool(inside and np.all(np.linalg.norm(rays, axis=1) <= self.valid_radius))

    @cached_property
    def valid_radius(self) -> float:
        """The largest radius of rays that the distortion does not fold back, infinite if none is:
        its polynomial is fitted within the image and means nothing far outside."""
        radii = np.linspace(0, _WIDEST_TANGENT, 10_001)
        rays = np.column_stack([radii, np.zeros_like(radii), np.ones_like(radii)])
        seen, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), np.eye(3), self.distortion)
        folds = np.flatnonzero(~(np.diff(seen[:, 0, 0]) > 0))  # or is no number
        return float(radii[folds[0]]) if folds.size else np.inf


def read_calibration(path: Path) -> Calibration:
    """A camera from a YAML, XML or JSON file of OpenCV: `image_width`, `image_height`,
    `camera_matrix`, `distortion_coefficients`, as OpenCV's calibration programs write them.

    Raises InputError naming the file and what is wrong in it.
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
    """The numbers of a matrix, by rows. OpenCV 4.11's own `mat()` reads whole numbers without a
    decimal point as other numbers (opencv-python's issue 1078)."""
    node = storage.getNode(name)
    data = node.getNode("data") if node.isMap() else node
    items = [data.at(place) for place in range(data.size())] if data.isSeq() else []
    if not data.isSeq() or not all(item.isInt() or item.isReal() for item in items):
        raise InputError(f"{path}: {name}: missing or not a matrix of numbers")
    numbers = np.array([item.real() for item in items], dtype=np.float64)
    if not np.isfinite(numbers).all():
        raise InputError(f"{path}: {name}: holds what is no number; calibrate again")
    return numbers


def _given(node: cv2.FileNode) -> bool:
    return bool(node.isInt() and node.real())


def _is_camera(matrix: Array) -> bool:
    """Whether a matrix (3, 3) has focal lengths above 0 and no skew, which OpenCV ignores."""
    shape = np.array([[1, 0, 1], [0, 1, 1], [0, 0, 1]])
    return bool(min(matrix[0, 0], matrix[1, 1]) > 0 and not matrix[shape == 0].any()
                and matrix[2, 2] == 1)  # fmt: skip
