"""The rendered rectangles, by hand and by their guarantees."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from shaftpose.core.cylinder import cylinder_depth
from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.rendering.meshes import shaft_mesh
from shaftpose.rendering.poses import PoseSampler
from shaftpose.rendering.regions import Region, cover, projected_outline
from shaftpose.settings.schema import RenderSettings

FREE = 0.0


def empty() -> NDArray[np.bool_]:
    return np.zeros((40, 60), dtype=bool)


def diagonal() -> NDArray[np.bool_]:
    rows, columns = np.indices((40, 60))
    return np.abs(2 * columns - 3 * rows) <= 6


def area(regions: list[Region]) -> int:
    return sum((r.x1 - r.x0) * (r.y1 - r.y0) for r in regions)


def test_nothing_needs_no_rectangle() -> None:
    assert cover(empty(), FREE) == []


def test_a_rectangle_is_its_own() -> None:
    mask = empty()
    mask[5:12, 20:50] = True
    assert cover(mask, FREE) == [Region(20, 5, 50, 12)]
    mask[:] = False
    mask[7, 9] = True
    assert cover(mask, FREE) == [Region(9, 7, 10, 8)]


@pytest.mark.parametrize("turned", [False, True])
def test_two_rectangles_are_parted_if_that_saves_more_than_a_render_costs(turned: bool) -> None:
    mask = empty()
    mask[0:4, 0:10] = mask[20:24, 30:40] = True
    whole, parts = Region(0, 0, 40, 24), [Region(0, 0, 10, 4), Region(30, 20, 40, 24)]
    if turned:
        mask = mask.T
        whole, *parts = (Region(r.y0, r.x0, r.y1, r.x1) for r in (whole, *parts))
    # 40 x 24 = 960 px in one; split after the first, 10 x 4 + 30 x 4 = 160 px.
    assert cover(mask, 799) == parts
    assert cover(mask, 800) == [whole]


@pytest.mark.parametrize("render_px", [FREE, 30.0, 200.0])
def test_rectangles_hold_everything_once(render_px: float) -> None:
    counts = np.zeros((40, 60), dtype=int)
    for region in cover(diagonal(), render_px):
        counts[region.slices] += 1
    assert counts.max() == 1
    assert np.all(counts[diagonal()] == 1)


def test_a_diagonal_is_cut_the_finer_the_cheaper_a_render_is() -> None:
    costs = 20.0, 200.0, 3000.0
    found = [cover(diagonal(), cost) for cost in costs]
    assert len(found[0]) > len(found[1]) > len(found[2]) == 1
    assert area(found[0]) < area(found[1]) < area(found[2]) == 40 * 60
    for regions, cost in zip(found, costs, strict=True):
        assert area(regions) + cost * (len(regions) - 1) <= 40 * 60


# Outlines of bodies.

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
