"""Camera, poses and angles, by hand and against independent constructions."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from shaftpose.core.cylinder import cylinder_depth
from shaftpose.core.geometry import (
    Camera,
    ShaftPose,
    axis_direction,
    pose_from_rotation,
    signed_deg,
    unsigned_deg,
)
from shaftpose.core.masks import mask_box

CAMERA = Camera.from_field_of_view(299, 299, 95.0)
DISTORTED = replace(CAMERA, k1=-0.2, k2=0.05)


def random_pose(rng: np.random.Generator) -> ShaftPose:
    low, high = [-10, -10, 15, 50, 0], [10, 10, 35, 90, 360]
    return ShaftPose.from_array(rng.uniform(low, high))


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
    camera = replace(CAMERA, field=CAMERA.disc(100.0))
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
