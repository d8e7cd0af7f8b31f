"""Camera, poses and cylinder silhouettes, by hand and against independent constructions."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from shaftpose.core.geometry import (
    Camera,
    ShaftPose,
    axis_direction,
    cylinder_depth,
    pose_from_rotation,
    segment_distance,
    signed_deg,
    unsigned_deg,
)
from shaftpose.core.masks import mask_box

CAMERA = Camera.from_field_of_view(299, 299, 95.0)
SMALL = Camera.from_field_of_view(61, 61, 95.0)


def random_pose(rng: np.random.Generator) -> ShaftPose:
    low, high = [-10, -10, 15, 50, 0], [10, 10, 35, 90, 360]
    return ShaftPose.from_array(rng.uniform(low, high))


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


def test_focal_length_of_the_paper() -> None:
    # 299 / (2 tan 47.5 deg) = 299 / (2 * 1.0913085) = 136.99.
    assert CAMERA.focal_px == pytest.approx(136.99, abs=0.005)
    assert (CAMERA.cx, CAMERA.cy) == (149.5, 149.5)


def test_projection_by_hand() -> None:
    camera = Camera(200, 100, focal_px=50.0, cx=100.0, cy=40.0)
    # (2, -4, 10): 50 * 0.2 + 100 = 110 and 50 * -0.4 + 40 = 20. The axis meets the centre.
    points = np.array([[2.0, -4.0, 10.0], [0.0, 0.0, 7.0]])
    np.testing.assert_allclose(camera.project(points), [[110, 20], [100, 40]])
    homogeneous = camera.matrix @ points[0]
    np.testing.assert_allclose(homogeneous[:2] / homogeneous[2], [110, 20])


def test_image_border_is_seen_under_half_the_view() -> None:
    # x / z = tan 47.5 deg lies on the right edge, u = 299.
    edge = np.array([np.tan(np.radians(47.5)), 0.0, 1.0])
    np.testing.assert_allclose(CAMERA.project(edge), [299.0, 149.5])


def test_rays_go_through_pixel_centres() -> None:
    rays = CAMERA.rays()
    assert rays.shape == (299, 299, 3)
    # Column 0 has its centre at 0.5, row 298 at 298.5; row and column 149 are the centre, 149.5.
    np.testing.assert_allclose(CAMERA.project(rays)[298, 0], [0.5, 298.5])
    np.testing.assert_allclose(rays[149, 149], [0, 0, 1])


@pytest.mark.parametrize(
    ("pitch", "yaw", "expected"),
    [
        (90, 0, (1, 0, 0)),
        (90, 90, (0, 1, 0)),
        (90, 180, (-1, 0, 0)),
        (0, 123, (0, 0, -1)),
        (60, 270, (0, -(3**0.5) / 2, -0.5)),  # sin 60 sin 270, -cos 60
    ],
)
def test_direction_by_hand(pitch: float, yaw: float, expected: tuple[float, ...]) -> None:
    np.testing.assert_allclose(ShaftPose(1, 2, 3, pitch, yaw).direction, expected, atol=1e-12)


def test_axis_direction_takes_arrays() -> None:
    directions = axis_direction(np.array([90.0, 0.0]), np.array([90.0, 0.0]))
    np.testing.assert_allclose(directions, [[0, 1, 0], [0, 0, -1]], atol=1e-12)


def test_rotation_is_one_and_its_third_column_is_the_direction() -> None:
    rng = np.random.default_rng(0)
    for pose in [random_pose(rng) for _ in range(50)] + [ShaftPose(0, 0, 1, 0, 30)]:
        rotation = pose.rotation
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(rotation) == pytest.approx(1)
        np.testing.assert_array_equal(rotation[:, 2], pose.direction)


def test_roll_is_fixed_by_the_derivative_by_pitch() -> None:
    # Pitch 90, yaw 0: d/dp (sin p, 0, -cos p) = (cos p, 0, sin p) = (0, 0, 1); z = (1, 0, 0);
    # y = z x x = (1, 0, 0) x (0, 0, 1) = (0, -1, 0).
    expected = np.array([[0, 0, 1], [0, -1, 0], [1, 0, 0]])
    np.testing.assert_allclose(ShaftPose(0, 0, 9, 90, 0).rotation, expected, atol=1e-12)


@pytest.mark.parametrize("yaw", [0.0, 0.001, 90.0, 179.999, 180.0, 270.0, 358.0, 359.999])
@pytest.mark.parametrize("pitch", [50.0, 70.0, 89.9, 120.0])
def test_pose_survives_the_way_through_its_rotation(pitch: float, yaw: float) -> None:
    pose = ShaftPose(-3.0, 4.0, 25.0, pitch, yaw)
    back = pose_from_rotation(pose.rotation, pose.tip_mm)
    np.testing.assert_allclose(back.as_array(), pose.as_array(), atol=1e-9)


def test_pose_from_rotation_ignores_roll() -> None:
    pose = ShaftPose(1, 2, 30, 65, 200)
    c, s = np.cos(0.7), np.sin(0.7)
    rolled = pose.rotation @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    back = pose_from_rotation(rolled, pose.tip_mm)
    np.testing.assert_allclose(back.as_array(), pose.as_array(), atol=1e-9)


def test_yaw_of_a_rotation_stays_below_a_full_turn() -> None:
    # sin 360 deg is -2.4e-16 in floating point: the yaw is a hair below 0, not 360.
    pose = ShaftPose(0, 0, 20, 70, 360.0)
    assert 0 <= pose_from_rotation(pose.rotation, pose.tip_mm).yaw_deg < 360


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


DISTORTED = replace(CAMERA, k1=-0.2, k2=0.05)


def test_distortion_is_that_of_opencv() -> None:
    rng = np.random.default_rng(12)
    points = np.column_stack([rng.uniform(-25, 25, (200, 2)), rng.uniform(20, 40, 200)])
    none = np.zeros(3)
    coefficients = np.array([DISTORTED.k1, DISTORTED.k2, 0, 0])
    expected, _ = cv2.projectPoints(points, none, none, DISTORTED.matrix, coefficients)
    np.testing.assert_allclose(DISTORTED.project(points), expected[:, 0], atol=1e-9)
    # By hand: x / z = 1, so u = f (1 - 0.2 + 0.05) + cx; the axis stays in the centre.
    on_axis = DISTORTED.project(np.array([[20.0, 0, 20], [0, 0, 20]]))
    np.testing.assert_allclose(on_axis, [[0.85 * CAMERA.focal_px + 149.5, 149.5], [149.5, 149.5]])


@pytest.mark.parametrize(("k1", "k2"), [(-0.2, 0.05), (0.3, 0.0), (-0.05, 0.0), (0.0, 0.1)])
def test_rays_of_a_distorted_camera_meet_their_pixels(k1: float, k2: float) -> None:
    camera = replace(CAMERA, k1=k1, k2=k2)
    for stride in (1, 4):
        v, u = np.mgrid[0:299:stride, 0:299:stride] + stride / 2
        pixels = camera.project(camera.rays(stride))
        np.testing.assert_allclose(pixels, np.stack([u, v], axis=-1), atol=1e-3)


def test_what_a_distortion_would_fold_back_stays_outside() -> None:
    # r (1 - 0.06 r^2) grows up to r = 2.357, where it is 1.571: the corner, 1.543, has a ray. At
    # r = 4 the formula gives 0.16, in the middle of the image.
    folding = replace(CAMERA, k1=-0.06)
    assert np.isfinite(folding.rays()).all()
    far = np.array([[4.0, 0, 1], [2.9, 2.9, 1], [40, 0, 10]])
    assert not folding.shows(folding.project(far)).any()
    empty = replace(CAMERA, k1=-0.08).rays()  # grows up to 1.361 at r = 2.041
    assert np.isnan(empty[0, 0, :2]).all()
    assert np.isfinite(empty[:, 149]).all()


def test_a_round_field_of_view() -> None:
    camera = replace(CAMERA, field_px=100.0)
    inside = camera.shows(np.array([[149.5, 99.5], [149.5, 99.4], [184.8, 184.8], [184.9, 184.9]]))
    assert inside.tolist() == [True, False, True, False]
    shown = np.isfinite(camera.rays()[..., 0])
    assert shown.sum() == pytest.approx(np.pi * 50**2, rel=0.01)
    assert mask_box(shown) == (99, 99, 200, 200)  # pixel centres at most 50 px from 149.5
    depth = cylinder_depth(camera, ShaftPose(0, 0, 20, 90, 0), 3.0, 150.0)
    assert np.isinf(depth[~shown]).all()
    assert np.isfinite(depth[149, 150:199]).all()
    edges = np.array([[0.0, 0], [298.9, 298.9], [299, 10], [10, -0.1]])
    assert CAMERA.shows(edges).tolist() == [True, True, False, False]


def test_roll_turns_a_shaft_about_its_own_axis() -> None:
    pose = ShaftPose(1, 2, 30, 65, 200)
    rolled = pose.rolled(90.0)
    np.testing.assert_allclose(rolled[:, 2], pose.direction)
    np.testing.assert_allclose(rolled[:, 0], pose.rotation[:, 1], atol=1e-12)
    np.testing.assert_allclose(rolled[:, 1], -pose.rotation[:, 0], atol=1e-12)
    np.testing.assert_array_equal(pose.rolled(0.0), pose.rotation)


@pytest.mark.parametrize(
    ("angle_deg", "signed", "unsigned"),
    [(0.0, 0.0, 0.0), (179.0, 179.0, 179.0), (180.0, -180.0, 180.0), (-180.0, -180.0, 180.0),
     (359.0, -1.0, 359.0), (-10.0, -10.0, 350.0), (725.0, 5.0, 5.0), (-1e-15, 0.0, 0.0)],
)  # fmt: skip
def test_angles_by_hand(angle_deg: float, signed: float, unsigned: float) -> None:
    assert signed_deg(angle_deg) == signed
    assert unsigned_deg(angle_deg) == unsigned


def test_all_angles_of_an_array_are_wrapped() -> None:
    angles = np.array([[-90.0, 270.0], [360.0, 540.0]])
    assert signed_deg(angles).tolist() == [[-90.0, -90.0], [0.0, -180.0]]
    assert unsigned_deg(angles).tolist() == [[270.0, 270.0], [0.0, 180.0]]
