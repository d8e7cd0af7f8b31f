"""The contour of a cylinder in closed form, and how it moves with the pose.

The contour of a shaft consists of two straight lines, the images of the planes through the camera
that touch the cylinder, and of the outer half of the ellipse that the tip's rim projects to.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.geometry import Camera, Disc, axis_direction

Array = NDArray[np.float64]

LINE_SAMPLES, _ARC_SAMPLES = 40, 24  # the arc has fewer than a line
_ALONG_LINE, _ALONG_ARC = np.linspace(0, 1, LINE_SAMPLES), np.linspace(-1, 1, _ARC_SAMPLES)
ARC = 2  # number of the tip's arc among the parts of a contour
_END_ON = 1e-6  # px per mm: slower, the line points at the camera
_LEAST_DEPTH_MM = 1.0  # of the whole tip
_MARGIN_PX = 1.0
# Samples of the rim whose normal is turned from the axis by less than about 70 deg: next to the
# lines, the rim's corners are blurred.
_FACING = 0.35


class Shaft(NamedTuple):
    """The shape of a shaft. flat_tip: whether the tip is a flat disc; with other tips, the contour
    consists of its lines alone."""

    diameter_mm: float
    length_mm: float = 150.0
    flat_tip: bool = True


class Contour(NamedTuple):
    """Samples of a contour inside the image.

    points: (N, 2) px. normals: (N, 2), unit vectors out of the silhouette. lengths: (N,) px of
    contour that each sample stands for. motion: (N, 5), derivatives of the displacement along the
    normals by the pose, px per mm and px per deg. parts: (N,), 0 and 1 on the lines, from the tip
    outwards, `ARC` on the arc. field: the image's round field, if it has one.
    """

    points: Array
    normals: Array
    lengths: Array
    motion: Array
    parts: NDArray[np.intp]
    field: Disc | None = None


_NO_CONTOUR = Contour(
    np.empty((0, 2)), np.empty((0, 2)), np.empty(0), np.empty((0, 5)), np.empty(0, np.intp)
)


class _Part(NamedTuple):
    """A part of a contour.

    points: (N, 3) on the shaft, mm; outward: (N, 3), directions out of the shaft; tangents: (N, 2)
    in the image; lengths: (N,) px that the points stand for; number: (N,), see `Contour.parts`.
    """

    points: Array
    outward: Array
    tangents: Array
    lengths: Array
    number: NDArray[np.intp]


def shaft_contour(pose: Array, shaft: Shaft, camera: Camera) -> Contour:
    """Sample the contour of a shaft with pose (5,) mm, deg as a pinhole camera sees it.

    Empty if the camera is inside the endless cylinder or the tip is not in front of the camera.
    """
    tip, axis, radius = pose[:3], axis_direction(pose[3], pose[4]), shaft.diameter_mm / 2
    across = tip - (tip @ axis) * axis
    distance = float(np.linalg.norm(across))
    if not (
        np.isfinite(pose).all() and distance > 1.001 * radius and tip[2] > radius + _LEAST_DEPTH_MM
    ):
        return _NO_CONTOUR
    away = across / distance
    aside = _cross(axis[None], away[None])[0]
    lean = np.arcsin(radius / distance)  # between a touching plane and the plane of the axis
    contacts = np.cos(lean) * np.array([aside, -aside]) - np.sin(lean) * away
    parts = [_lines(tip + radius * contacts, contacts, axis, shaft.length_mm, camera)]
    if shaft.flat_tip:
        parts.append(_arc(tip, axis, radius, away, aside, lean, camera))
    points, outward, tangents, lengths, numbers = map(np.concatenate, zip(*parts, strict=True))
    normals = np.stack([tangents[:, 1], -tangents[:, 0]], axis=1)
    by_point = _by_point(points, normals, camera)
    inwards = (by_point * outward).sum(axis=1) < 0
    normals[inwards] *= -1
    by_point[inwards] *= -1
    motion = _motion(points, by_point, pose)
    return Contour(camera.project(points), normals, lengths, motion, numbers, camera.field)


def _lines(starts: Array, contacts: Array, axis: Array, length_mm: float, camera: Camera) -> _Part:
    """The lines start + t axis, 0 <= t <= length_mm, with points evenly spaced in the image.

    starts, contacts: (2, 3), the ends at the tip and their directions from the axis.
    """
    depths = starts[:, 2:]
    course = camera.focal_px * (axis[:2] - axis[2] * starts[:, :2] / depths)
    speeds = np.linalg.norm(course, axis=1, keepdims=True)
    directions = course / np.maximum(speeds, _END_ON)
    # The image of t lies t speed / (depth + t axis_z) px from the image of the start.
    end_depths = depths + length_mm * axis[2]
    most = np.where(end_depths > 0, length_mm * speeds / np.maximum(end_depths, 1e-9), np.inf)
    low, high = camera.span(camera.project(starts), directions)
    low, high = np.maximum(low, 0.0) + _MARGIN_PX, np.minimum(high, most) - _MARGIN_PX
    seen = (low < high)[:, 0] & (speeds > _END_ON)[:, 0]
    px = low + (high - low) * _ALONG_LINE
    t = px * depths / (speeds - px * axis[2])
    points = (starts[:, None] + t[..., None] * axis)[seen].reshape(-1, 3)
    lengths = ((high - low) / LINE_SAMPLES)[seen, 0]
    of_lines = contacts[seen], directions[seen], lengths, np.flatnonzero(seen)
    return _Part(points, *(np.repeat(of_line, LINE_SAMPLES, axis=0) for of_line in of_lines))


def _arc(
    tip: Array, axis: Array, radius: float, away: Array, aside: Array, lean: float, camera: Camera
) -> _Part:
    """The part of the tip's rim that faces away from the handle."""
    half = _ALONG_ARC * (np.pi / 2 + lean)
    # The lines touch the rim at +-(90 deg + lean) from `away`: one of the two arcs is outside.
    course = axis[:2] - axis[2] * tip[:2] / tip[2]
    beyond = camera.project(tip + radius * away) - camera.project(tip)
    if beyond @ course > 0:
        half = np.pi + half * (np.pi / 2 - lean) / (np.pi / 2 + lean)
    turn = half[:, None]
    radial = np.cos(turn) * away + np.sin(turn) * aside
    rims = tip + radius * radial
    along = radius * (np.cos(turn) * aside - np.sin(turn) * away)
    tangents = along[:, :2] - along[:, 2:] * rims[:, :2] / rims[:, 2:]
    speeds = np.linalg.norm(tangents, axis=1)
    tangents = tangents / np.maximum(speeds, 1e-9)[:, None]
    lengths = camera.focal_px / rims[:, 2] * speeds * abs(half[1] - half[0])
    across = np.abs(tangents @ np.array([-course[1], course[0]]))
    kept = across > _FACING * max(float(np.linalg.norm(course)), 1e-9)
    kept &= camera.shows(camera.project(rims)) & (speeds > 1e-9)
    return _Part(
        rims[kept], (radial - axis)[kept], tangents[kept], lengths[kept], np.full(kept.sum(), ARC)
    )


def _by_point(points: Array, normals: Array, camera: Camera) -> Array:
    """Derivatives (N, 3) of image points along their normals by the points (N, 3), px per mm."""
    depth = points[:, 2:]
    slope = -(normals * points[:, :2]).sum(axis=1, keepdims=True) / depth
    return camera.focal_px / depth * np.concatenate([normals, slope], axis=1)


def _motion(points: Array, by_point: Array, pose: Array) -> Array:
    """Derivatives (N, 5) of a contour along its normals by the pose, px per mm and px per deg, from
    those by its points (N, 3), see `_by_point`.

    A contour moves along its normals like the points of the rigid body that lie on it.
    """
    yaw = np.radians(pose[4])
    spins = [[np.sin(yaw), -np.cos(yaw), 0.0], [0.0, 0.0, 1.0]]
    torque = _cross(points - pose[:3], by_point)
    return np.concatenate([by_point, np.radians(torque @ np.transpose(spins))], axis=1)


def _cross(a: Array, b: Array) -> Array:
    """The cross products of rows (N, 3), several times as fast as NumPy's."""
    (a0, a1, a2), (b0, b1, b2) = a.T, b.T
    return np.stack([a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0], axis=1)
