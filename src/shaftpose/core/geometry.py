"""Camera and shaft geometry: projection, poses and angles.

Camera frame (OpenCV): x right, y down, z forward, mm. A pixel's centre lies at integer + 0.5.
Shaft frame: origin at the centre of the distal tip, +z from the tip towards the handle.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Angle = TypeVar("Angle", float, NDArray[np.float64])  # one angle, or many of any shape

# Distance from the tip to a second point of the axis, which is in front of the camera in every pose
# in view.
_AXIS_STEP_MM = 1.0
_PARALLEL = 1e-9  # smaller components of a direction count as this


@dataclass(frozen=True)
class Disc:
    """The round picture of a scope: its centre and diameter, px."""

    x: float
    y: float
    diameter: float

    def enlarged(self, times: float) -> "Disc":
        """The same disc in an image with `times` as many pixels a side."""
        return Disc(times * self.x, times * self.y, times * self.diameter)

    def border_px(self, pixels: Array) -> Array:
        """Distances (...) of pixels (..., 2) from the circle, negative outside."""
        away = np.linalg.norm(pixels - np.array([self.x, self.y]), axis=-1)
        return np.asarray(self.diameter / 2 - away)

    def span(self, starts: Array, directions: Array) -> tuple[Array, Array]:
        """The range of s, two arrays (N,), in which lines start + s direction lie in the disc.

        starts: (N, 2) px; directions: (N, 2), unit vectors. For lines that miss the disc the first
        is the larger one.
        """
        offsets = starts - np.array([self.x, self.y])
        middle = -(offsets * directions).sum(axis=1)
        square = middle**2 + self.diameter**2 / 4 - (offsets**2).sum(axis=1)
        half = np.where(square > 0, np.sqrt(np.maximum(square, 0.0)), -1.0)
        return middle - half, middle + half


@dataclass(frozen=True)
class Camera:
    """A camera with square pixels; `focal_px`, `cx` and `cy` in pixels.

    k1, k2: OpenCV's radial distortion, which moves a point at distance r f from the principal
    point to r (1 + k1 r^2 + k2 r^4) f; a pinhole if both are 0. field: what is visible of the
    image; None: all of it.
    """

    width: int
    height: int
    focal_px: float
    cx: float
    cy: float
    k1: float = 0.0
    k2: float = 0.0
    field: Disc | None = None

    @classmethod
    def from_field_of_view(cls, width: int, height: int, view_deg: float) -> "Camera":
        """A centred pinhole camera with the horizontal field of view `view_deg` (paper, II)."""
        focal_px = width / (2 * np.tan(np.radians(view_deg) / 2))
        return cls(width, height, float(focal_px), width / 2, height / 2)

    def enlarged(self, times: int) -> "Camera":
        """The camera of the same view with `times` as many pixels along each side."""
        return replace(
            self,
            width=times * self.width,
            height=times * self.height,
            focal_px=times * self.focal_px,
            cx=times * self.cx,
            cy=times * self.cy,
            field=None if self.field is None else self.field.enlarged(times),
        )

    def cropped(self, x: int, y: int, width: int, height: int) -> "Camera":
        """The camera of a part of the image, whose first pixel is `x, y`."""
        field = self.field
        if field is not None:
            field = Disc(field.x - x, field.y - y, field.diameter)
        return replace(
            self, width=width, height=height, cx=self.cx - x, cy=self.cy - y, field=field
        )

    def disc(self, diameter_px: float | None) -> Disc | None:
        """A disc around the principal point; None without a diameter."""
        return None if diameter_px is None else Disc(self.cx, self.cy, diameter_px)

    @property
    def matrix(self) -> Array:
        """The (3, 3) intrinsic matrix K."""
        return np.array([[self.focal_px, 0, self.cx], [0, self.focal_px, self.cy], [0, 0, 1.0]])

    def project(self, points_mm: Array) -> Array:
        """Pixels (..., 2) of camera-frame points (..., 3); u = f x / z + cx without distortion.

        Points beyond the largest valid radius of a distortion are clamped to it.
        """
        offsets = self.focal_px * points_mm[..., :2] / points_mm[..., 2:]
        if self.k1 or self.k2:
            radius = np.linalg.norm(offsets, axis=-1, keepdims=True) / self.focal_px
            followed = np.minimum(radius, self._rim)
            offsets = offsets * _ratio(self._distorted(followed), radius)
        return offsets + np.array([self.cx, self.cy])

    def border_px(self, pixels: Array) -> Array:
        """Distances (...) of pixels (..., 2) from the nearest border, negative outside."""
        border = np.minimum(pixels, [self.width, self.height] - pixels).min(axis=-1)
        if self.field is not None:
            border = np.minimum(border, self.field.border_px(pixels))
        return np.asarray(border)

    def lift(self, pixels: Array, depth_mm: float) -> Array:
        """x and y (..., 2) mm of pixels (..., 2) at a depth; only for a pinhole camera."""
        return np.asarray((pixels - [self.cx, self.cy]) / self.focal_px * depth_mm)

    def span(self, starts: Array, directions: Array) -> tuple[Array, Array]:
        """The range of s, two arrays (N, 1), in which lines start + s direction lie in the image.

        starts: (N, 2) px; directions: (N, 2), unit vectors. For lines that miss the image or its
        round field the first is the larger one.
        """
        corners = np.array([[[0.0, 0.0]], [[self.width, self.height]]])
        # A line parallel to a border meets it far away.
        ends = (corners - starts) / np.where(abs(directions) < _PARALLEL, _PARALLEL, directions)
        low, high = ends.min(axis=0).max(axis=1), ends.max(axis=0).min(axis=1)
        if self.field is not None:
            enters, leaves = self.field.span(starts, directions)
            low, high = np.maximum(low, enters), np.minimum(high, leaves)
        return low[:, None], high[:, None]

    def rays(self, stride: int = 1) -> Array:
        """Directions (h, w, 3), with z = 1, through the centres of blocks, `stride` px a side.

        x and y are NaN outside the field of view. The array is read-only.
        """
        return _rays(self, stride)

    def shows(self, pixels: Array) -> NDArray[np.bool_]:
        """Whether pixels (..., 2) lie in the image, and in its round field if it has one."""
        size = np.array([self.width, self.height])
        inside: NDArray[np.bool_] = np.all((pixels >= 0) & (pixels < size), axis=-1)
        if self.field is not None:
            inside &= self.field.border_px(pixels) >= 0
        return inside

    def _distorted(self, radius: Array) -> Array:
        return radius * (1 + self.k1 * radius**2 + self.k2 * radius**4)

    def _undistorted(self, seen: Array) -> Array:
        """Inverse of `_distorted`, from a table exact to 0.001 px; NaN beyond the table."""
        radius = np.linspace(0, self._rim, 2**14)
        return np.interp(seen, self._distorted(radius), radius, right=np.nan)

    @property
    def _rim(self) -> float:
        """The largest valid radius of the distortion, at most three times the corner's radius.

        Beyond it the image would fold back: the derivative 1 + 3 k1 r^2 + 5 k2 r^4 is 0 there.
        """
        far_x, far_y = max(self.cx, self.width - self.cx), max(self.cy, self.height - self.cy)
        corner = float(np.hypot(far_x, far_y)) / self.focal_px
        roots = np.roots([5 * self.k2, 3 * self.k1, 1.0])
        folds = [float(root.real) ** 0.5 for root in roots if root.imag == 0 and root.real > 0]
        return min([3 * corner, *folds])


def _ratio(radius: Array, by: Array) -> Array:
    """radius / by; 1 at the centre, where both are 0."""
    return np.divide(radius, by, out=np.ones_like(by), where=by > 0)


@lru_cache(maxsize=8)  # a set has few cameras, and every annotation needs their rays
def _rays(camera: Camera, stride: int) -> Array:
    u = np.arange(0, camera.width, stride) + 0.5 * stride
    v = np.arange(0, camera.height, stride) + 0.5 * stride
    x, y = np.meshgrid((u - camera.cx) / camera.focal_px, (v - camera.cy) / camera.focal_px)
    rays = np.stack([x, y, np.ones_like(x)], axis=-1)
    if camera.k1 or camera.k2:
        seen = np.hypot(x, y)
        rays[..., :2] *= _ratio(camera._undistorted(seen), seen)[..., None]
    if camera.field is not None:
        rays[~camera.shows(np.stack(np.meshgrid(u, v), axis=-1)), :2] = np.nan
    rays.flags.writeable = False
    return rays


def signed_deg(angle: Angle) -> Angle:
    """The same angle in [-180, 180) deg; made for differences of angles."""
    return (angle + 180.0) % 360.0 - 180.0


def unsigned_deg(angle: Angle) -> Angle:
    """The same angle in [0, 360) deg."""
    return angle % 360.0 % 360.0  # twice: the remainder of a tiny negative angle rounds to 360


@dataclass(frozen=True)
class ShaftPose:
    """The 5-DoF pose of a shaft: its tip in mm and its two angles in degrees."""

    x_mm: float
    y_mm: float
    z_mm: float
    pitch_deg: float
    yaw_deg: float

    @classmethod
    def from_array(cls, pose: Array) -> "ShaftPose":
        """From (5,): x_mm, y_mm, z_mm, pitch_deg, yaw_deg."""
        return cls(*(float(value) for value in pose))

    def as_array(self) -> Array:
        """(5,): x_mm, y_mm, z_mm, pitch_deg, yaw_deg."""
        return np.array([self.x_mm, self.y_mm, self.z_mm, self.pitch_deg, self.yaw_deg])

    @property
    def tip_mm(self) -> Array:
        """(3,) the tip in the camera frame."""
        return np.array([self.x_mm, self.y_mm, self.z_mm])

    @property
    def direction(self) -> Array:
        """(3,) unit vector from the tip towards the handle."""
        return axis_direction(np.array(self.pitch_deg), np.array(self.yaw_deg))

    @property
    def rotation(self) -> Array:
        """(3, 3) rotation from shaft to camera frame.

        The third column is `direction`. The roll of a symmetric shaft is arbitrary: the first
        column is the derivative of `direction` by pitch.
        """
        pitch, yaw = np.radians(self.pitch_deg), np.radians(self.yaw_deg)
        x_axis = np.array([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)])
        z_axis = self.direction
        return np.stack([x_axis, np.cross(z_axis, x_axis), z_axis], axis=1)

    def rolled(self, roll_deg: float) -> Array:
        """(3, 3) `rotation` with a roll about the shaft's axis, for instruments without
        rotational symmetry."""
        if not roll_deg:
            return self.rotation
        c, s = np.cos(np.radians(roll_deg)), np.sin(np.radians(roll_deg))
        return self.rotation @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def axis_direction(pitch_deg: Array, yaw_deg: Array) -> Array:
    """Unit vectors (..., 3) from tip to handle: (sin p cos w, sin p sin w, -cos p)."""
    pitch, yaw = np.radians(pitch_deg), np.radians(yaw_deg)
    components = [np.sin(pitch) * np.cos(yaw), np.sin(pitch) * np.sin(yaw), -np.cos(pitch)]
    return np.stack(components, axis=-1)


def projected_axes(poses: Array, camera: Camera) -> Array:
    """Axes in the image (N, 2, 2) px of poses (N, 5): the tip, and a point towards the handle."""
    tips = poses[:, :3]
    others = tips + _AXIS_STEP_MM * axis_direction(poses[:, 3], poses[:, 4])
    return camera.project(np.stack([tips, others], axis=1))


def pose_from_rotation(rotation: Array, tip_mm: Array) -> ShaftPose:
    """The pose whose axis is the third column of `rotation` (3, 3); yaw in [0, 360) deg."""
    return pose_along(rotation[:, 2], tip_mm)


def pose_along(axis: Array, tip_mm: Array) -> ShaftPose:
    """The pose with an axis, a unit vector (3,) from tip to handle; yaw in [0, 360) deg."""
    pitch = float(np.degrees(np.arccos(np.clip(-axis[2], -1.0, 1.0))))
    yaw = unsigned_deg(float(np.degrees(np.arctan2(axis[1], axis[0]))))
    x_mm, y_mm, z_mm = (float(value) for value in tip_mm)
    return ShaftPose(x_mm, y_mm, z_mm, pitch, yaw)
