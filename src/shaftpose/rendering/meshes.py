"""Meshes as plain arrays: rods, and lumps of tissue."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SIDES = 96  # a rod of 96 sides differs from a cylinder by 0.001 mm


@dataclass(frozen=True)
class Mesh:
    """vertices: (V, 3) mm; faces: vertex indices; uv: (corners, 2), in the order of faces."""

    vertices: Array
    faces: tuple[tuple[int, ...], ...]
    uv: Array

    @cached_property
    def edges(self) -> NDArray[np.int64]:
        """(E, 2) vertex indices of all edges."""
        pairs = [
            (a, b) for face in self.faces for a, b in zip(face, face[1:] + face[:1], strict=True)
        ]
        return np.unique(np.sort(np.array(pairs), axis=1), axis=0)


def shaft_mesh(diameter_mm: float, length_mm: float) -> Mesh:
    """A rod in the shaft frame: tip at the origin, handle at +z; u around, v along in mm."""
    return revolved_mesh(np.array([[diameter_mm / 2, 0.0], [diameter_mm / 2, length_mm]]))


def revolved_mesh(profile_mm: Array) -> Mesh:
    """The closed surface of revolution about z of a profile (P, 2), radius and z from the tip."""
    angles = 2 * np.pi * np.arange(SIDES) / SIDES
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    rings = [np.column_stack([radius * circle, np.full(SIDES, z)]) for radius, z in profile_mm]
    sides = tuple(
        (start + n, start + (n + 1) % SIDES, start + (n + 1) % SIDES + SIDES, start + n + SIDES)
        for start in range(0, SIDES * (len(rings) - 1), SIDES)
        for n in range(SIDES)
    )
    last = SIDES * (len(rings) - 1)
    caps = (tuple(range(SIDES))[::-1], tuple(range(last, last + SIDES)))
    return Mesh(np.concatenate(rings), sides + caps, _revolved_uv(profile_mm, circle))


def _revolved_uv(profile_mm: Array, circle: Array) -> Array:
    """UV in mm: the sides unrolled, the caps seen from above."""
    u = np.pi * 2 * profile_mm[:, 0].max() * np.arange(SIDES + 1) / SIDES
    v = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(profile_mm, axis=0), axis=1))])
    sides = [[(u[n], v[p]), (u[n + 1], v[p]), (u[n + 1], v[p + 1]), (u[n], v[p + 1])]
             for p in range(len(v) - 1) for n in range(SIDES)]  # fmt: skip
    tip, handle = profile_mm[0, 0] * circle, profile_mm[-1, 0] * circle
    return np.concatenate([np.array(sides).reshape(-1, 2), tip[::-1], handle])


def wrapped_uv(vertices: Array, faces: Sequence[tuple[int, ...]]) -> Array:
    """UV in mm for a mesh of any shape along z. Each face is unrolled around the axis at its mean
    distance; faces across the axis are seen from above."""
    sizes = np.array([len(face) for face in faces])
    starts = np.cumsum(sizes) - sizes
    corners = vertices[np.fromiter(chain.from_iterable(faces), dtype=np.int64)]
    following = np.arange(1, len(corners) + 1)
    following[starts + sizes - 1] = starts
    # Newell's formula: normals of faces with any number of corners.
    normals = np.add.reduceat(np.cross(corners, corners[following]), starts)
    across = np.abs(normals[:, 2]) > 0.7 * np.linalg.norm(normals, axis=1)
    angles = np.arctan2(corners[:, 1], corners[:, 0])
    # A face on the seam, at half a turn, must not span the whole circumference.
    first = np.repeat(angles[starts], sizes)
    angles = first + (angles - first + np.pi) % (2 * np.pi) - np.pi
    radii = np.add.reduceat(np.hypot(corners[:, 0], corners[:, 1]), starts) / sizes
    unrolled = np.column_stack([np.repeat(radii, sizes) * angles, corners[:, 2]])
    return np.where(np.repeat(across, sizes)[:, None], corners[:, :2], unrolled)


def lump_mesh(radii_mm: tuple[float, float, float], shape_seed: int) -> Mesh:
    """An ellipsoid around the origin with a smoothly uneven surface."""
    rows, columns = 16, 24
    polar = np.linspace(0, np.pi, rows + 1)[:, None]
    azimuth = 2 * np.pi * np.arange(columns)[None] / columns
    unit = np.stack(
        [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth),
         np.broadcast_to(np.cos(polar), (rows + 1, columns))], axis=-1)  # fmt: skip
    vertices = (unit * _unevenness(unit, shape_seed)[..., None] * np.array(radii_mm)).reshape(-1, 3)
    faces = [
        (r * columns + c, (r + 1) * columns + c,
         (r + 1) * columns + (c + 1) % columns, r * columns + (c + 1) % columns)
        for r in range(rows) for c in range(columns)
    ]  # fmt: skip
    uv = unit.reshape(-1, 3)[np.array(faces).ravel(), :2] * 0.5 + 0.5
    return Mesh(vertices, tuple(faces), uv)


def _unevenness(unit: Array, shape_seed: int) -> Array:
    """Radial factor around 1 for points (..., 3) on the unit sphere: a sum of plane waves."""
    rng = np.random.default_rng(shape_seed)
    waves = rng.normal(size=(8, 3)) * rng.uniform(1, 4, size=(8, 1))
    phases = rng.uniform(0, 2 * np.pi, size=8)
    wobble: Array = 1 + 0.06 * np.sin(unit @ waves.T + phases).sum(axis=-1)
    return wobble
