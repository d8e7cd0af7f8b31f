import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from shaftpose.core.errors import InputError
from shaftpose.rendering.meshes import Mesh, shaft_mesh, wrapped_uv
from shaftpose.rendering.shapes import instrument_shape, surrounding_rod
from shaftpose.settings.parsing import parse
from shaftpose.settings.schema import ShaftSettings

TIPS = ("flat", "chamfered", "rounded", "forceps")


def shaft(**changed: object) -> ShaftSettings:
    values = {"diameter_mm": 4.0, "length_mm": 100.0, "tip": "flat", "bevel_mm": 1.0,
              "jaw_angle_deg": 30.0, "cad": None}  # fmt: skip
    return parse(ShaftSettings, values | changed, "params.yaml: shaft.")


def solid(mesh: Mesh) -> trimesh.Trimesh:
    """The mesh in triangles: fans of its convex faces."""
    fans = [(f[0], f[n], f[n + 1]) for f in mesh.faces for n in range(1, len(f) - 1)]
    return trimesh.Trimesh(mesh.vertices, fans, process=False)


@pytest.mark.parametrize("tip", TIPS)
def test_a_shape_is_closed_faces_outwards_and_fits_its_rod(tip: str) -> None:
    shape = instrument_shape(shaft(tip=tip))
    body = solid(shape.mesh)
    assert body.is_watertight
    assert body.is_winding_consistent
    assert body.volume > 0
    low, high = body.bounds
    assert low[2] == pytest.approx(0)
    assert high[2] == pytest.approx(shape.length_mm) == pytest.approx(100.0)
    radius = np.hypot(*shape.mesh.vertices[:, :2].T).max()
    assert radius == pytest.approx(shape.diameter_mm / 2)
    assert sum(len(face) for face in shape.mesh.faces) == len(shape.mesh.uv)
    assert (shape.is_rod, shape.revolved) == (tip == "flat", tip != "forceps")


def rings(mesh: Mesh) -> list[tuple[float, float]]:
    """Radius and z of the vertices, without duplicates, from the tip."""
    pairs = {(round(float(np.hypot(x, y)), 6), round(float(z), 6)) for x, y, z in mesh.vertices}
    return sorted(pairs, key=lambda pair: (pair[1], pair[0]))


def test_the_flat_tip_is_the_plain_shaft() -> None:
    mesh, plain = instrument_shape(shaft()).mesh, shaft_mesh(4.0, 100.0)
    assert mesh.faces == plain.faces
    np.testing.assert_array_equal(mesh.vertices, plain.vertices)
    np.testing.assert_array_equal(mesh.uv, plain.uv)


def test_a_chamfer_takes_its_width_from_radius_and_length() -> None:
    assert rings(instrument_shape(shaft(tip="chamfered")).mesh) == [(1, 0), (2, 1), (2, 100)]


def test_a_rounded_tip_has_its_radius() -> None:
    found = np.array(rings(instrument_shape(shaft(tip="rounded")).mesh))
    arc = found[found[:, 1] <= 1]
    assert len(arc) > 8
    np.testing.assert_allclose(np.hypot(arc[:, 0] - 1, arc[:, 1] - 1), 1, atol=1e-5)


@pytest.mark.parametrize("angle", [0.0, 40.0, 120.0])
def test_jaws_open_by_their_angle(angle: float) -> None:
    vertices = instrument_shape(shaft(tip="forceps", jaw_angle_deg=angle)).mesh.vertices
    jaws = np.split(vertices[2 * 96 :], 2)
    directions = []
    for jaw in jaws:
        # The flat sides meet at the hinge, the x axis; each end is also a half circle.
        hinge, end = np.split(jaw, 2)
        on_flat_side = [0, -1]
        directions.append(end[on_flat_side].mean(axis=0) - hinge[on_flat_side].mean(axis=0))
        assert np.linalg.norm(directions[-1]) == pytest.approx(12.0)  # three diameters
    cosine = directions[0] @ directions[1] / 12.0**2
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))) == pytest.approx(angle, abs=1e-4)
    # The jaws point away from the handle, one up, one down, and reach the origin's plane.
    assert all(direction[2] < 0 for direction in directions)
    assert jaws[0][:, 1].mean() == pytest.approx(-jaws[1][:, 1].mean())
    assert vertices[:, 2].min() == pytest.approx(0)


def test_the_rod_around_a_forceps_holds_its_open_jaws() -> None:
    narrow, wide = (
        surrounding_rod(shaft(tip="forceps", jaw_angle_deg=angle)) for angle in (10.0, 90.0)
    )
    assert 4.0 == narrow.diameter_mm < wide.diameter_mm
    assert narrow.length_mm == wide.length_mm == pytest.approx(100.0)
    assert surrounding_rod(shaft()) == shaft()


def test_a_bevel_leaves_part_of_the_tip() -> None:
    for tip in ("chamfered", "rounded"):
        with pytest.raises(InputError, match="bevel_mm = 2 must be less than half of") as caught:
            shaft(tip=tip, bevel_mm=2.0)
        assert "\n" not in str(caught.value)
        assert str(caught.value).startswith("params.yaml: shaft: ")
    shaft(bevel_mm=2.0)  # not used


def face_corners(mesh: Mesh) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Vertices and UV of each face."""
    ends = np.cumsum([len(face) for face in mesh.faces])
    uv = np.split(mesh.uv, ends[:-1])
    return [(mesh.vertices[list(face)], part) for face, part in zip(mesh.faces, uv, strict=True)]


def test_wrapped_texture_is_that_of_the_rod_but_for_where_it_begins() -> None:
    rod = shaft_mesh(4.0, 100.0)
    wrapped = Mesh(rod.vertices, rod.faces, wrapped_uv(rod.vertices, rod.faces))
    for (_, own), (_, found) in zip(face_corners(rod), face_corners(wrapped), strict=True):
        np.testing.assert_allclose(found - found[0], own - own[0], atol=1e-9)


def test_wrapped_texture_follows_the_distance_from_the_axis() -> None:
    """The texture is equally fine on thin and thick parts of a mesh."""
    thin, thick = shaft_mesh(2.0, 50.0), shaft_mesh(20.0, 50.0)
    count = len(thin.vertices)
    faces = thin.faces + tuple(tuple(n + count for n in face) for face in thick.faces)
    uv = wrapped_uv(np.concatenate([thin.vertices, thick.vertices]), faces)
    widths = [np.ptp(uv[4 * n : 4 * n + 4, 0]) for n in range(96)]
    np.testing.assert_allclose(widths, np.pi * 2 / 96)
