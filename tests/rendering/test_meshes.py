import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from shaftpose.core.geometry import Camera, ShaftPose, cylinder_depth
from shaftpose.rendering.meshes import Mesh, lump_mesh, projected_outline, shaft_mesh
from shaftpose.rendering.poses import PoseSampler
from shaftpose.settings.schema import RenderSettings

DIAMETER_MM, LENGTH_MM = 3.0, 150.0
# Passes next to the camera and behind it: 60 % of it lies behind the image plane.
BESIDE_CAMERA = ShaftPose(-12.0, 3.0, 38.0, 50.0, 170.0)


def in_camera(points: NDArray[np.float64], pose: ShaftPose) -> NDArray[np.float64]:
    return points @ pose.rotation.T + pose.tip_mm


def surface_points() -> NDArray[np.float64]:
    """Dense points of a true cylinder's side, rims included, in the shaft frame."""
    angles = np.linspace(0, 2 * np.pi, 360, endpoint=False)
    along = np.linspace(0, LENGTH_MM, 6001)
    ring = DIAMETER_MM / 2 * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    grid = np.empty((len(along), len(angles), 3))
    grid[..., :2], grid[..., 2] = ring, along[:, None]
    return grid.reshape(-1, 3)


def outline_of(camera: Camera, pose: ShaftPose) -> NDArray[np.float32] | None:
    mesh = shaft_mesh(DIAMETER_MM, LENGTH_MM)
    return projected_outline(camera, in_camera(mesh.vertices, pose), mesh.edges)


@pytest.fixture(scope="module")
def poses(camera: Camera, settings: RenderSettings) -> list[ShaftPose]:
    draw = PoseSampler(camera, settings.poses, settings.shaft, settings.scene)
    rng = np.random.default_rng(9)
    return [draw(rng, 1).poses[0] for _ in range(10)]


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


def test_the_outline_of_a_rod_is_its_silhouette(camera: Camera, poses: list[ShaftPose]) -> None:
    assert np.mean(in_camera(surface_points(), BESIDE_CAMERA)[:, 2] < 0) > 0.5
    for pose in [*poses, BESIDE_CAMERA]:
        outline = outline_of(camera, pose)
        assert outline is not None
        exact = np.isfinite(cylinder_depth(camera, pose, DIAMETER_MM, LENGTH_MM))
        assert cv2.contourArea(outline) == pytest.approx(exact.sum(), rel=0.01)
        for y, x in np.argwhere(exact) + 0.5:
            assert cv2.pointPolygonTest(outline, (x, y), measureDist=True) > -0.05


@pytest.mark.parametrize(
    "pose", [ShaftPose(0, 0, -20, 60, 0), ShaftPose(200, 0, 20, 90, 0)], ids=["behind", "beside"]
)
def test_a_shaft_out_of_view_has_no_outline(camera: Camera, pose: ShaftPose) -> None:
    assert outline_of(camera, pose) is None


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
