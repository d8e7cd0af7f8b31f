"""A user's camera, as OpenCV calibrates it: intrinsics and lens distortion.

`core.geometry.Camera` is the camera of a model and of the renderer, with square pixels and at most
radial distortion in closed form. A calibration maps the rays of such a camera to the pixels of a
real one, which need not be square, with all of OpenCV's distortions, its fisheye lens included.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.core.errors import InputError
from shaftpose.core.geometry import Array, Camera

_BORDER_RAYS = 101  # on each side of a square
_TANGENT_STEP = 1e-9  # a thousandth of a pixel of the longest focal length
_WIDEST = 2.75  # of rays in an undistorted picture, whose size grows with it: 70 deg from the axis
_WIDEST_TANGENT = 10.0  # rays farther from the optical axis than 84 deg are never asked for
_AXES = np.array([[-1.0, 0], [1, 0], [0, -1], [0, 1]])
_AROUND = np.vstack([_AXES, np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]]) / np.sqrt(2)])
# Of a frame's longer side; a fisheye lens of 180 deg has 0.3.
_FOCAL_LENGTHS = 0.005, 100.0
_OBLONGEST = 4.0  # of a pixel's sides
_LEAST_LEFT = 0.1  # of a frame's side that an undistorted picture shows


class Places(NamedTuple):
    """Where samples of a camera's image, (H, W) each, lie in the frames of a calibrated camera.

    x, y: float32 px, for pixel centres at whole numbers, as `cv2.remap` takes them. inside: whether
    the frame shows the place.
    """

    x: NDArray[np.float32]
    y: NDArray[np.float32]
    inside: NDArray[np.bool_]


@dataclass(frozen=True)
class Calibration:
    """A calibrated camera with frames of `width` x `height` px.

    matrix: (3, 3) px. Only inside this class, pixel centres lie at whole numbers, as in OpenCV; in
    the rest of the project they lie at + 0.5. distortion: (D,), k1, k2, p1, p2, k3, ... of
    `cv2.projectPoints`, or k1 to k4 of `cv2.fisheye` if it is a fisheye lens.
    """

    width: int
    height: int
    matrix: Array
    distortion: Array
    fisheye: bool = False

    @classmethod
    def pinhole(
        cls, width: int, height: int, view_deg: float, aspect: float = 1.0
    ) -> "Calibration":
        """A centred camera without distortion; view_deg: the angle across the central square of its
        frames; aspect: width / height of its pixels."""
        side_px = min(aspect * width, height)  # in heights of a pixel
        focal_px = side_px * Camera.from_field_of_view(1, 1, view_deg).focal_px
        return cls._centred(width, height, focal_px / aspect, focal_px)

    @classmethod
    def scaled(cls, camera: Camera, width: int, height: int) -> "Calibration":
        """The camera of frames that are a centred pinhole's image in another size."""
        focal_x, focal_y = (
            camera.focal_px * side / own
            for side, own in ((width, camera.width), (height, camera.height))
        )
        return cls._centred(width, height, focal_x, focal_y)

    @classmethod
    def _centred(cls, width: int, height: int, focal_x: float, focal_y: float) -> "Calibration":
        matrix = [[focal_x, 0, (width - 1) / 2], [0, focal_y, (height - 1) / 2], [0, 0, 1]]
        return cls(width, height, np.array(matrix), np.zeros(0))

    @property
    def aspect(self) -> float:
        """Width / height of a pixel."""
        return float(self.matrix[1, 1] / self.matrix[0, 0])

    @property
    def focal_px(self) -> float:
        """The focal length, in the shorter side of a pixel."""
        return float(max(self.matrix[0, 0], self.matrix[1, 1]))

    def image_px(self, rays: Array) -> Array:
        """Pixels (N, 2), centres at + 0.5, of rays (N, 2): x / z and y / z.

        Rays beyond the lens's valid radius are moved to it.
        """
        radius = np.linalg.norm(rays, axis=1, keepdims=True)
        followed = rays * np.minimum(1, self.valid_radius / np.maximum(radius, 1e-12))
        return self._projected(followed, self.matrix) + 0.5

    def _projected(self, rays: Array, matrix: Array) -> Array:
        if not len(rays):  # OpenCV returns None
            return np.zeros((0, 2))
        points, lens = np.column_stack([rays, np.ones(len(rays))])[:, None], self.distortion
        project = cv2.fisheye.projectPoints if self.fisheye else cv2.projectPoints
        return np.asarray(project(points, np.zeros(3), np.zeros(3), matrix, lens)[0][:, 0])

    def check(self) -> None:
        """Raise InputError if the camera cannot have taken its frames."""
        size, centre = np.array([self.width, self.height]), self.matrix[:2, 2] + 0.5
        near = float(np.min([centre, size - centre]))
        frames = f"frames of {self.width} x {self.height} px"
        lengths = np.diag(self.matrix)[:2].tolist()
        if max(lengths) > _OBLONGEST * min(lengths):
            raise InputError(
                "focal lengths of {:g} and {:g} px are not those of one lens; calibrate "
                "again".format(*lengths)
            )
        least, most = (size.max() * share for share in _FOCAL_LENGTHS)
        for focal_px in lengths:
            if not least <= focal_px <= most:
                raise InputError(
                    f"a focal length of {focal_px:g} px is not that of {frames}; calibrate again"
                )
        if near < 1:
            raise InputError(
                f"the camera's principal point {np.round(centre - 0.5, 1).tolist()} lies outside "
                f"of its {frames}; calibrate again"
            )
        if not self._fold_px >= near:  # NaN, too
            raise InputError(
                f"the lens distortion folds back {self._fold_px:.0f} px from the principal point, "
                f"within its {frames}; calibrate again, with corners up to the frame's border"
            )
        left = self.undistorted(self.focal_px)
        if min(left.width / self.width, left.height / self.height) < _LEAST_LEFT:
            raise InputError(
                f"without lens distortion, {left.width} x {left.height} px are left of its "
                f"{frames}; calibrate again"
            )

    def cuts(self) -> list[str]:
        """Sentences about what an undistorted picture leaves out of the frame."""
        found, frames = [], f"frames of {self.width} x {self.height} px"
        size, centre = np.array([self.width, self.height]), self.matrix[:2, 2] + 0.5
        if self._fold_px < np.linalg.norm(np.maximum(centre, size - centre)):
            found.append(
                f"the lens distortion folds back {self._fold_px:.0f} px from the principal point: "
                f"what lies farther away in {frames} is not seen"
            )
        if any(self._sees(_WIDEST * axis[None]) for axis in _AXES):
            found.append(
                f"{frames} see more than {2 * np.degrees(np.arctan(_WIDEST)):.0f} deg: what lies "
                "beyond is not seen"
            )
        return found

    def undistorted(self, focal_px: float) -> Camera:
        """The pinhole camera of this focal length with the largest picture that the frame fills.

        The frame's outline, curved once it is undistorted, encloses the picture; its corners may be
        cut.
        """
        ends = [_largest(partial(self._sees_along, axis[None]), _WIDEST) for axis in _AXES]
        border = _square_border()
        border = np.where(border < 0, border * [ends[0], ends[2]], border * [ends[1], ends[3]])
        left, right, up, down = _largest(partial(self._sees_along, border), 1.0) * np.array(ends)
        # Whole pixels; the small part of one absorbs rounding.
        width, height = (int(focal_px * size + 1e-3) for size in (left + right, up + down))
        return Camera(width, height, focal_px, float(focal_px * left), float(focal_px * up))

    def places_of(self, camera: Camera, samples: int) -> Places:
        """The places of `samples` x `samples` samples in each pixel of a pinhole camera that looks
        the same way."""
        width, height = samples * camera.width, samples * camera.height
        matrix = np.diag([samples, samples, 1.0]) @ camera.matrix
        matrix[:2, 2] -= 0.5
        undistort = (cv2.fisheye if self.fisheye else cv2).initUndistortRectifyMap
        x, y = undistort(
            self.matrix, self.distortion, np.eye(3), matrix, (width, height), cv2.CV_32FC1
        )
        rays_x = (np.arange(width) - matrix[0, 2]) / matrix[0, 0]
        rays_y = (np.arange(height) - matrix[1, 2]) / matrix[1, 1]
        inside = np.hypot(rays_x, rays_y[:, None]) <= self.valid_radius
        inside &= (x >= -0.5) & (x <= self.width - 0.5)
        inside &= (y >= -0.5) & (y <= self.height - 0.5)
        return Places(x.astype(np.float32, copy=False), y.astype(np.float32, copy=False), inside)

    def widest_view_deg(self) -> float:
        """The view angle of the widest square image that an undistorted camera, looking the same
        way, can take from the frame."""
        tangent = _largest(partial(self._sees_along, _square_border()), _WIDEST_TANGENT)
        return float(np.degrees(2 * np.arctan(tangent)))

    def _sees_along(self, rays: Array, factor: float) -> bool:
        return self._sees(factor * rays)

    def _sees(self, rays: Array) -> bool:
        """Whether the rays (N, 2) all lie in the frame."""
        pixels, size = self.image_px(rays), np.array([self.width, self.height])
        inside = np.all((pixels >= 0) & (pixels <= size))
        return bool(inside and np.all(np.linalg.norm(rays, axis=1) <= self.valid_radius))

    @cached_property
    def valid_radius(self) -> float:
        """The largest radius sqrt(x^2 + y^2) / z of rays before the distortion folds back, infinite
        if it never does. Its polynomial is fitted within the image and means nothing far outside.
        """
        radii = np.linspace(0, _WIDEST_TANGENT, 10_001)
        rays = radii[:, None, None] * _AROUND
        seen = self._projected(rays.reshape(-1, 2), np.eye(3)).reshape(rays.shape)
        outwards = np.diff((seen * _AROUND).sum(axis=-1), axis=0)
        folds = np.flatnonzero(~(outwards > 0).all(axis=1))  # NaN, too
        return float(radii[folds[0]]) if folds.size else np.inf

    @cached_property
    def _fold_px(self) -> float:
        """The distance from the principal point at which the distortion folds back."""
        if np.isinf(self.valid_radius):
            return np.inf
        *folds, centre = self.image_px(np.vstack([self.valid_radius * _AROUND, np.zeros(2)]))
        return float(np.linalg.norm(folds - centre, axis=1).min())


def _square_border() -> Array:
    """Points (N, 2) on the border of the square from -1 to 1."""
    along, beside = np.linspace(-1, 1, _BORDER_RAYS), np.ones(_BORDER_RAYS)
    sides = ((along, beside), (along, -beside), (beside, along), (-beside, along))
    return np.concatenate([np.column_stack(side) for side in sides])


def _largest(holds: Callable[[float], bool], most: float) -> float:
    """The largest number up to `most` for which a condition, which holds for small ones, holds."""
    if holds(most):
        return most
    low, high = 0.0, most
    while high - low > _TANGENT_STEP:
        middle = (low + high) / 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low
