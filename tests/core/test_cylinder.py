"""Cylinder silhouettes and distances, by hand and against independent constructions."""

import cv2
import numpy as np
import pytest

from shaftpose.core.cylinder import cylinder_depth, segment_distance
from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.core.masks import mask_box
from tests.core.test_geometry import random_pose

CAMERA = Camera.from_field_of_view(299, 299, 95.0)
SMALL = Camera.from_field_of_view(61, 61, 95.0)


def points_on_rays(camera: Camera, depths_mm: np.ndarray) -> np.ndarray:
    """(h, w, N, 3) points at the given depths behind every pixel's centre, from u = f x / z + c."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width] + 0.5
    x = (u - camera.cx)[..., None] * depths_mm / camera.focal_px
    y = (v - camera.cy)[..., None] * depths_mm / camera.focal_px
    return np.stack([x, y, np.broadcast_to(depths_mm, x.shape)], axis=-1)


def inside_cylinder(
    points: np.ndarray, pose: ShaftPose, radius: float, length: float
) -> np.ndarray:
    """Whether points (..., 3) are in the solid, in the shaft frame: p = R^T (q - tip)."""
    local = (points - pose.tip_mm) @ pose.rotation
    radial = np.hypot(local[..., 0], local[..., 1])
    return (radial <= radius) & (local[..., 2] >= 0) & (local[..., 2] <= length)


def test_depth_and_width_of_a_shaft_across_the_view_by_hand() -> None:
    # The shaft runs along +x from (0, 0, 20), radius 1.5. In the plane of a column the rays are
    # (k / f, m, 1), k and m in pixels from the centre over f; pixel 149 has k = 0.
    depth = cylinder_depth(CAMERA, ShaftPose(0, 0, 20, 90, 0), 3.0, 150.0)
    # Row 149 looks along the axis' plane: the front of the shaft lies at 20 - 1.5 = 18.5 mm.
    np.testing.assert_allclose(depth[149, 150:], 18.5)
    # Rays to the left of the tip miss it.
    assert np.all(np.isinf(depth[:, :149]))
    # A ray touches when 20 m / sqrt(1 + m^2) = 1.5, so m = 1.5 / sqrt(400 - 2.25) = 0.0752123,
    # and f m = 136.99 * 0.0752123 = 10.30: rows 149 - 10 .. 149 + 10, 21 pixels.
    assert mask_box(np.isfinite(depth)[:, 150:]) == (0, 139, 149, 160)
    assert np.isfinite(depth)[:, 200].sum() == 21


def test_depth_at_the_centre_ray_by_hand() -> None:
    depth = cylinder_depth(CAMERA, ShaftPose(-5, 0, 20, 90, 0), 3.0, 150.0)
    assert depth[149, 149] == pytest.approx(18.5)


def test_depth_of_the_end_disc_by_hand() -> None:
    # The tip's disc lies in the plane x = 5 and is seen from the left. In row 149 the ray of
    # k = column - 149 meets it at z = 5 f / k, if 18.5 <= z <= 21.5: k = 32 .. 37.
    depth = cylinder_depth(CAMERA, ShaftPose(5, 0, 20, 90, 0), 3.0, 150.0)[149]
    assert np.isinf(depth[149 + 31])  # 5 * 136.99 / 31 = 22.1: passes behind the disc
    assert depth[149 + 32] == pytest.approx(5 * 136.991 / 32, abs=1e-3)  # 21.405
    assert depth[149 + 37] == pytest.approx(5 * 136.991 / 37, abs=1e-3)  # 18.512
    assert depth[149 + 38] == pytest.approx(18.5)  # the side from here


def test_far_end_of_a_short_shaft_by_hand() -> None:
    # A shaft of 4 mm along +x from x = 0. Row 149 meets its front, z = 18.5, at x = 18.5 k / f <= 4
    # for k <= 4 f / 18.5 = 29.6: columns 149 + 1 .. 149 + 29.
    depth = cylinder_depth(CAMERA, ShaftPose(0, 0, 20, 90, 0), 3.0, 4.0)[149]
    assert np.flatnonzero(np.isfinite(depth))[-1] == 149 + 29


def test_shaft_that_passes_beside_the_camera_by_hand() -> None:
    # Along -z from (5, 0, 20), past the camera to z = -130. Row 149 meets the inner side x = 3.5 at
    # z = 3.5 f / k <= 20, so k >= 23.97; nothing of it lies to the left.
    depth = cylinder_depth(CAMERA, ShaftPose(5, 0, 20, 0, 0), 3.0, 150.0)
    assert np.all(np.isinf(depth[149, : 149 + 24]))
    k = np.arange(24, 150)
    np.testing.assert_allclose(depth[149, 149 + 24 :], 3.5 * CAMERA.focal_px / k)
    assert np.all(depth > 0)


def test_shaft_behind_the_camera_is_not_seen() -> None:
    assert np.all(np.isinf(cylinder_depth(SMALL, ShaftPose(0, 0, -20, 90, 0), 3.0, 150.0)))
    # Behind the camera, tip first: only the axis extended beyond the tip crosses the view.
    assert np.all(np.isinf(cylinder_depth(SMALL, ShaftPose(1, 2, -5, 50, 30), 3.0, 150.0)))


@pytest.mark.parametrize("seed", range(6))
def test_depth_agrees_with_points_along_the_rays(seed: int) -> None:
    """Compares with the first of many points along a ray that is inside the solid."""
    pose = random_pose(np.random.default_rng(seed))
    camera = Camera.from_field_of_view(31, 31, 95.0)
    step = 0.02
    depths = np.arange(step, 50, step)
    inside = inside_cylinder(points_on_rays(camera, depths), pose, 1.5, 150.0)
    hit = inside.any(axis=-1)
    first = depths[inside.argmax(axis=-1)]
    exact = cylinder_depth(camera, pose, 3.0, 150.0)
    assert hit.sum() > 5
    # Each point inside is behind the exact surface, by less than a step.
    behind = (first - exact)[hit]
    assert np.all((behind >= -1e-9) & (behind <= step + 1e-9))
    # Only a ray with a chord shorter than a step can miss all points.
    assert np.sum(np.isfinite(exact) & ~hit) <= 2


@pytest.mark.parametrize("seed", range(6))
def test_silhouette_is_the_hull_of_the_projected_ends(seed: int) -> None:
    """The hull of two rings in front of the camera projects to the hull of their projections."""
    pose = random_pose(np.random.default_rng(100 + seed))
    length = 12.0  # the handle stays at z >= 15 - 12 * cos 50 - 1.5 > 5
    angles = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    ring = np.stack([1.5 * np.cos(angles), 1.5 * np.sin(angles), np.zeros(720)], axis=1)
    local = np.concatenate([ring, ring + [0, 0, length]])
    pixels = SMALL.project(local @ pose.rotation.T + pose.tip_mm)
    hull = cv2.convexHull(pixels.astype(np.float32))
    exact = np.isfinite(cylinder_depth(SMALL, pose, 3.0, length))
    for row in range(61):
        for column in range(61):
            distance = cv2.pointPolygonTest(hull, (column + 0.5, row + 0.5), True)
            if abs(distance) > 0.01:
                assert exact[row, column] == (distance > 0)


def test_odd_stride_picks_every_nth_pixel() -> None:
    pose = ShaftPose(2, -3, 20, 70, 40)
    # Blocks of 3 x 3 pixels: their centres are those of pixels 1, 4, 7, ...
    np.testing.assert_allclose(
        cylinder_depth(CAMERA, pose, 3.0, 150.0, stride=3)[:99, :99],
        cylinder_depth(CAMERA, pose, 3.0, 150.0)[1:298:3, 1:298:3],
    )


def test_stride_two_is_a_camera_of_half_the_size() -> None:
    pose = ShaftPose(2, -3, 20, 70, 40)
    # (2 k + 1 - 60) / 100 = (k + 0.5 - 30) / 50.
    np.testing.assert_allclose(
        cylinder_depth(Camera(120, 120, 100.0, 60.0, 60.0), pose, 3.0, 150.0, stride=2),
        cylinder_depth(Camera(60, 60, 50.0, 30.0, 30.0), pose, 3.0, 150.0),
    )


@pytest.mark.parametrize(
    ("a", "b", "expected"),
    [
        # Crossing at the origin.
        ([(-1, 0, 0), (1, 0, 0)], [(0, -1, 0), (0, 1, 0)], 0),
        # Skew: one above the other by 3.
        ([(-1, 0, 0), (1, 0, 0)], [(0, -1, 3), (0, 1, 3)], 3),
        # Parallel, side by side, 2 apart; one behind the other, (1, 2) from end to end.
        ([(0, 0, 0), (4, 0, 0)], [(1, 2, 0), (9, 2, 0)], 2),
        ([(0, 0, 0), (4, 0, 0)], [(5, 2, 0), (9, 2, 0)], 5**0.5),
        # On one line, a gap of 3.
        ([(0, 0, 0), (4, 0, 0)], [(7, 0, 0), (9, 0, 0)], 3),
        # A point and a segment: foot inside (distance 5) and beyond the end (3-4-5 triangle).
        ([(2, 5, 0), (2, 5, 0)], [(0, 0, 0), (9, 0, 0)], 5),
        ([(12, 4, 0), (12, 4, 0)], [(0, 0, 0), (9, 0, 0)], 5),
        # End to end, askew: (1, 0, 0) and (3, 2, 1) are 3 apart.
        ([(0, 0, 0), (1, 0, 0)], [(3, 2, 1), (3, 9, 1)], 3),
        # End of the first on the inside of the second.
        ([(0, 2, 0), (0, 9, 0)], [(-5, 0, 0), (5, 0, 0)], 2),
    ],
)
def test_segment_distance_by_hand(
    a: list[tuple[float, ...]], b: list[tuple[float, ...]], expected: float
) -> None:
    start_a, end_a = np.array(a, dtype=float)
    start_b, end_b = np.array(b, dtype=float)
    assert segment_distance(start_a, end_a, start_b, end_b) == pytest.approx(expected)
    assert segment_distance(end_a, start_a, end_b, start_b) == pytest.approx(expected)


def test_segment_distance_agrees_with_sampled_points() -> None:
    rng = np.random.default_rng(4)
    share = np.linspace(0, 1, 201)[:, None]
    for _ in range(30):
        (p, q), (r, s) = rng.normal(size=(2, 2, 3)) * 10
        first, second = p + share * (q - p), r + share * (s - r)
        sampled = np.linalg.norm(first[:, None] - second[None], axis=-1).min()
        exact = segment_distance(p, q, r, s)
        # Samples are at most half a spacing from the nearest points, on each segment.
        spacing = (np.linalg.norm(q - p) + np.linalg.norm(s - r)) / 200 / 2
        assert exact - 1e-9 <= sampled <= exact + spacing
