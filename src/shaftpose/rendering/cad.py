"""The user's CAD file as a mesh in the shaft frame."""

import logging

import numpy as np
import trimesh
from numpy.typing import NDArray
from trimesh import Trimesh
from trimesh.intersections import slice_faces_plane

from shaftpose.core.errors import InputError
from shaftpose.rendering.meshes import Mesh, wrapped_uv
from shaftpose.settings.schema import CadSettings

Array = NDArray[np.float64]

logger = logging.getLogger(__name__)

_FORMATS = (".stl", ".obj", ".glb")
_UNITS_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "inch": 25.4}
_SHORTEST_MM, _LONGEST_MM, _USUAL_MM = 5.0, 1000.0, 300.0
# Sizes outside of these cause a warning, such as an instrument in cm or inch read in mm.
_USUALLY_SHORTEST_MM, _USUAL_DIAMETERS_MM = 60.0, (1.0, 15.0)
# Share of an instrument's length, from an end, used to find the tip and to centre it.
_END = 0.05


def cad_mesh(cad: CadSettings) -> Mesh:
    """The file's mesh in mm: the origin is the centre of the distal tip, +z points to the handle.

    Textures and colours are ignored. The size is logged, as a warning if it is unusual. Raises
    InputError if the file is not a readable mesh or not of an instrument's size.
    """
    body = _load(cad)
    body.vertices = body.vertices @ _axes(body, cad.axis).T
    if not body.extents[2]:
        raise InputError(
            f"{cad.file}: flat along {cad.axis}; set shaft.cad.axis to its longest one"
        )
    if _tip_is_high(body, cad.tip):
        body.vertices = body.vertices * [1, -1, -1]
    low, high = _end(body, tip_is_high=False)
    body.vertices = body.vertices - [*(low + high)[:2] / 2, low[2]]
    faces = tuple(tuple(int(n) for n in face) for face in body.faces)
    vertices = np.asarray(body.vertices, dtype=np.float64)
    _log_size(cad, vertices)
    return Mesh(vertices, faces, wrapped_uv(vertices, faces))


def _load(cad: CadSettings) -> Trimesh:
    """The file's triangles in mm, merged into one mesh."""
    if cad.file.suffix.lower() not in _FORMATS:
        raise InputError(f"{cad.file}: not an STL, OBJ or GLB file; export one from your CAD tool")
    try:
        body = trimesh.load_mesh(cad.file)
    except Exception as error:  # each format's reader raises its own
        reason = str(error).strip().splitlines() or [type(error).__name__]
        raise InputError(f"{cad.file}: cannot be read ({reason[0]}); export it again") from error
    if not len(body.faces):
        raise InputError(f"{cad.file}: holds no triangles; export it again, as a mesh")
    body.apply_scale(_UNITS_MM[cad.unit])
    _check_size(cad, body)
    # Files repeat a vertex for each of its normals or texture coordinates.
    body.merge_vertices(merge_tex=True, merge_norm=True)
    if not body.is_watertight:
        logger.warning(
            "%s is not watertight: masks may show its holes; close them in your CAD program",
            cad.file,
        )
    body.update_faces(body.nondegenerate_faces())
    body.remove_unreferenced_vertices()
    return body


def _check_size(cad: CadSettings, body: Trimesh) -> None:
    if _SHORTEST_MM <= body.extents.max() <= _LONGEST_MM:
        return
    size = " x ".join(f"{extent:.3g}" for extent in body.extents)
    native = body.extents.max() / _UNITS_MM[cad.unit]
    lengths = {unit: native * factor for unit, factor in _UNITS_MM.items()}
    possible = [unit for unit in lengths if _SHORTEST_MM <= lengths[unit] <= _LONGEST_MM]
    likely = sorted(possible, key=lambda unit: abs(lengths[unit] - _USUAL_MM))[:1]
    remedy = f"try shaft.cad.unit = {likely[0]}" if likely else "check the file"
    raise InputError(
        f"{cad.file}: measures {size} mm, read in {cad.unit}, but an instrument is "
        f"{_SHORTEST_MM:g} to {_LONGEST_MM:g} mm long; {remedy}"
    )


def _log_size(cad: CadSettings, vertices: Array) -> None:
    """Log the length and the diameter of the smallest rod around the axis and all vertices."""
    length = vertices[:, 2].max()
    diameter = 2 * np.hypot(vertices[:, 0], vertices[:, 1]).max()
    thinnest, thickest = _USUAL_DIAMETERS_MM
    size = f"{cad.file}: {length:.3g} mm long and up to {diameter:.3g} mm thick, read in {cad.unit}"
    if length >= _USUALLY_SHORTEST_MM and thinnest <= diameter <= thickest:
        logger.info("%s", size)
        return
    logger.warning(
        "%s; expected a length of at least %g mm and a thickness of %g to %g mm: correct "
        "shaft.cad.unit, or remove the parts that never enter the body",
        size, _USUALLY_SHORTEST_MM, thinnest, thickest,
    )  # fmt: skip


def _axes(body: Trimesh, axis: str | None) -> Array:
    """Rotation (3, 3) whose last row is the instrument's axis."""
    if axis is not None:
        return np.roll(np.eye(3), 2 - "xyz".index(axis), axis=0)
    # The second moments of the surface: exact for triangles, and defined for open meshes.
    corners = body.triangles - body.centroid
    sums = corners.sum(axis=1)
    moments = np.einsum("f,fci,fcj->ij", body.area_faces, corners, corners)
    moments += np.einsum("f,fi,fj->ij", body.area_faces, sums, sums)
    # Eigenvectors in ascending order, signed so that their largest component is positive.
    _, across, along = (v * np.sign(v[np.abs(v).argmax()]) for v in np.linalg.eigh(moments)[1].T)
    return np.stack([across, np.cross(along, across), along])


def _tip_is_high(body: Trimesh, tip: str | None) -> bool:
    """Whether the tip is at the end with greater z: as set by `tip`, else at the thinner end."""
    if tip is not None:
        return tip == "high"
    low, high = (np.ptp(_end(body, end)[:, :2], axis=0).max() for end in (False, True))
    return bool(high < 0.99 * low)


def _end(body: Trimesh, tip_is_high: bool) -> Array:
    """Corners (2, 3) of the bounding box of one end of a body along z."""
    bottom, top = body.bounds[:, 2]
    depth = _END * (top - bottom)
    z, outwards = (top - depth, 1) if tip_is_high else (bottom + depth, -1)
    cut, _, _ = slice_faces_plane(body.vertices, body.faces, [0, 0, outwards], [0, 0, z])
    return np.stack([cut.min(axis=0), cut.max(axis=0)])
