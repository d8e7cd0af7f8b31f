import numpy as np
import pytest

from shaftpose.rendering.meshes import Mesh, lump_mesh, shaft_mesh

DIAMETER_MM, LENGTH_MM = 3.0, 150.0


def test_shaft_has_its_size_and_its_tip_at_the_origin() -> None:
    vertices = shaft_mesh(DIAMETER_MM, LENGTH_MM).vertices
    radius = DIAMETER_MM / 2
    np.testing.assert_allclose(vertices.min(axis=0), [-radius, -radius, 0], atol=1e-12)
    np.testing.assert_allclose(vertices.max(axis=0), [radius, radius, LENGTH_MM], atol=1e-12)
    np.testing.assert_allclose(np.hypot(vertices[:, 0], vertices[:, 1]), radius)
    tip = vertices[vertices[:, 2] == 0]
    np.testing.assert_allclose(tip.mean(axis=0), 0, atol=1e-12)


@pytest.mark.parametrize("mesh", [shaft_mesh(3.0, 150.0), lump_mesh((2.0, 3.0, 1.0), 4)])
def test_faces_point_outwards_and_have_texture_corners(mesh: Mesh) -> None:
    assert sum(len(face) for face in mesh.faces) == len(mesh.uv)
    middle = mesh.vertices.mean(axis=0)
    outwards = []
    for face in mesh.faces:
        corners = mesh.vertices[list(face)]
        # Newell's formula holds for faces of any number of corners, degenerate ones included.
        normal = np.cross(corners, np.roll(corners, -1, axis=0)).sum(axis=0)
        outwards.append(normal @ (corners.mean(axis=0) - middle))
    assert min(outwards) > 0


def test_edges_of_the_shaft_are_its_rims_and_its_sides() -> None:
    mesh = shaft_mesh(DIAMETER_MM, LENGTH_MM)
    sides = len(mesh.vertices) // 2
    lengths = np.linalg.norm(
        mesh.vertices[mesh.edges[:, 0]] - mesh.vertices[mesh.edges[:, 1]], axis=1
    )
    assert len(mesh.edges) == 3 * sides
    assert np.sum(np.isclose(lengths, LENGTH_MM)) == sides


@pytest.mark.parametrize("seed", range(5))
def test_lumps_stay_near_their_ellipsoid(seed: int) -> None:
    radii = (3.0, 2.0, 1.0)
    # Eight waves of amplitude 0.06 around 1.
    share = np.linalg.norm(lump_mesh(radii, seed).vertices / np.array(radii), axis=1)
    assert share.min() >= 1 - 0.48
    assert share.max() <= 1 + 0.48
    assert np.ptp(share) > 0.05


def test_a_lump_depends_on_its_seed() -> None:
    first, again, other = (lump_mesh((1.0, 1.0, 1.0), seed).vertices for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert not np.allclose(first, other)
