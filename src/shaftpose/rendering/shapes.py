"""The instrument's body: a rod with one of four tips, or the user's CAD file."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from shaftpose.rendering.cad import cad_mesh
from shaftpose.rendering.meshes import Mesh, revolved_mesh, shaft_mesh, wrapped_uv
from shaftpose.settings.schema import ShaftSettings

Array = NDArray[np.float64]

_ROUNDING_STEPS = 12
_JAW_SIDES = 24  # of the half circle that is a jaw's cross-section
_JAW_LENGTH = 3.0  # in diameters of the shaft
_JAW_END = 0.4  # a jaw's width at its end, relative to that at its hinge


@dataclass(frozen=True)
class Shape:
    """The instrument's body in the shaft frame.

    diameter_mm, length_mm: of the smallest rod from the origin along z that contains the mesh;
    is_rod: whether the mesh is that rod; revolved: whether it is rotationally symmetric.
    """

    mesh: Mesh
    diameter_mm: float
    length_mm: float
    is_rod: bool
    revolved: bool


@cache
def instrument_shape(shaft: ShaftSettings) -> Shape:
    """The body described by the settings. Raises InputError if its CAD file cannot be used."""
    if shaft.cad is not None:
        return _any_shape(cad_mesh(shaft.cad))
    if shaft.tip == "forceps":
        return _any_shape(forceps_mesh(shaft.diameter_mm, shaft.length_mm, shaft.jaw_angle_deg))
    if shaft.tip == "flat":
        mesh = shaft_mesh(shaft.diameter_mm, shaft.length_mm)
    else:
        mesh = revolved_mesh(_bevelled_profile(shaft))
    return Shape(mesh, shaft.diameter_mm, shaft.length_mm, shaft.tip == "flat", revolved=True)


def surrounding_rod(shaft: ShaftSettings) -> ShaftSettings:
    """The plain rod around an instrument of any shape, used to sample poses."""
    shape = instrument_shape(shaft)
    size = {"diameter_mm": shape.diameter_mm, "length_mm": shape.length_mm}
    return replace(shaft, tip="flat", cad=None, **size)


def _any_shape(mesh: Mesh) -> Shape:
    radius = np.hypot(mesh.vertices[:, 0], mesh.vertices[:, 1]).max()
    length = mesh.vertices[:, 2].max()
    return Shape(mesh, 2 * float(radius), float(length), is_rod=False, revolved=False)


def _bevelled_profile(shaft: ShaftSettings) -> Array:
    """Radius and z (P, 2), from the tip, of a chamfered or rounded rod."""
    radius, bevel = shaft.diameter_mm / 2, shaft.bevel_mm
    steps = 1 if shaft.tip == "chamfered" else _ROUNDING_STEPS
    angles = np.linspace(0, np.pi / 2, steps + 1)
    rim = np.column_stack([radius - bevel + bevel * np.sin(angles), bevel - bevel * np.cos(angles)])
    return np.vstack([rim, [radius, shaft.length_mm]])


def forceps_mesh(diameter_mm: float, length_mm: float, jaw_angle_deg: float) -> Mesh:
    """A rod that ends in two half-round jaws, opened by `jaw_angle_deg` in the y-z plane."""
    jaws = jaws_mesh(diameter_mm, _JAW_LENGTH * diameter_mm, jaw_angle_deg)
    reach = -jaws.vertices[:, 2].min()
    rod = shaft_mesh(diameter_mm, length_mm - reach)
    vertices = np.concatenate([rod.vertices, jaws.vertices]) + [0, 0, reach]
    start = len(rod.vertices)
    faces = rod.faces + tuple(tuple(start + n for n in face) for face in jaws.faces)
    return Mesh(vertices, faces, wrapped_uv(vertices, faces))


def jaws_mesh(diameter_mm: float, length_mm: float, angle_deg: float) -> Mesh:
    """Two half-round jaws from a hinge at the origin towards -z, opened in the y-z plane."""
    half = np.radians(angle_deg) / 2
    upper, faces = _jaw(diameter_mm / 2, length_mm)
    # A rotation about the hinge, the x axis; z points to the handle, the jaw to -z.
    upper = upper @ np.array([[1, 0, 0], [0, np.cos(half), np.sin(half)],
                              [0, -np.sin(half), np.cos(half)]])  # fmt: skip
    lower = upper * [-1, -1, 1]  # half a turn about z
    vertices = np.concatenate([upper, lower])
    both = tuple(tuple(start + n for n in face) for start in (0, len(upper)) for face in faces)
    return Mesh(vertices, both, wrapped_uv(vertices, both))


def _jaw(radius: float, length: float) -> tuple[Array, list[tuple[int, ...]]]:
    """Vertices and faces of a tapering half-round bar on the side of +y, from z = 0 to -length."""
    angles = np.linspace(0, np.pi, _JAW_SIDES + 1)
    section = radius * np.column_stack([np.cos(angles), np.sin(angles)])
    count = len(section)
    hinge = np.column_stack([section, np.zeros(count)])
    end = np.column_stack([_JAW_END * section, np.full(count, -length)])
    around = [(n, (n + 1) % count) for n in range(count)]
    sides = [(a, a + count, b + count, b) for a, b in around]
    caps = [tuple(range(count)), tuple(range(count, 2 * count))[::-1]]
    return np.concatenate([hinge, end]), sides + caps
