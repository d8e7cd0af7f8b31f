"""Means of what is found in mirrored and turned images."""

import numpy as np
import pytest
from numpy.typing import NDArray

from shaftpose.core.geometry import Camera, ShaftPose, pose_along
from shaftpose.core.instruments import Detections
from shaftpose.inference.symmetric_views import found_in_views, mean_detections

CAMERA = Camera.from_field_of_view(100, 100, 95.0)
POSE = np.array([4.0, -7.0, 22.0, 65.0, 130.0])
DEPTHS_MM, SHIFT_PX, SHIFT_MM = (22.0, 20.0), 1.5, 0.4


def marked(pose: NDArray[np.float64]) -> NDArray[np.uint8]:
    """A black image with a white pixel at the tip and a grey one further along the axis."""
    one = ShaftPose.from_array(pose)
    image = np.zeros((100, 100, 3), np.uint8)
    for depth_mm, grey in zip(DEPTHS_MM, (255, 128), strict=True):
        point = one.tip_mm + (depth_mm - one.z_mm) / one.direction[2] * one.direction
        u, v = CAMERA.project(point)
        image[int(v), int(u)] = grey
    return image


def find(images: NDArray[np.uint8]) -> list[Detections]:
    """Reads the poses of marked images; boxes and tips are too far to the right."""
    found = []
    for image in images:
        pixels = [np.argwhere(image[..., 0] == grey)[0][::-1] + 0.5 for grey in (255, 128)]
        points = [
            np.array([*CAMERA.lift(pixel, depth_mm), depth_mm])
            for pixel, depth_mm in zip(pixels, DEPTHS_MM, strict=True)
        ]
        axis = (points[1] - points[0]) / np.linalg.norm(points[1] - points[0])
        pose = pose_along(axis, points[0] + [SHIFT_MM, 0, 0]).as_array()
        box = np.array([*pixels[0] - [28, 30], *pixels[0] + [32 + SHIFT_PX, 30]])
        found.append(Detections(box[None], np.array([0.75]), pose[None]))
    return found


def test_an_error_that_is_the_same_in_all_copies_cancels_out() -> None:
    images = np.stack([marked(POSE), marked(POSE * [-1, 1, 1, 1, 0.5])])
    (once, _), (mean, other) = find(images), found_in_views(find, images)
    np.testing.assert_allclose(mean.scores, [0.75])
    np.testing.assert_allclose(mean.poses[0, 3:], once.poses[0, 3:])
    np.testing.assert_allclose(mean.poses[0, :3], once.poses[0, :3] - [SHIFT_MM, 0, 0])
    x0, y0, x1, y1 = mean.boxes[0]
    tip = CAMERA.project(mean.poses[0, :3])
    np.testing.assert_allclose([(x0 + x1) / 2, (y0 + y1) / 2], tip)
    np.testing.assert_allclose([x1 - x0, y1 - y0], [60.75, 60.75])  # of 61.5 and 60 px
    assert other.poses[0, 0] < 0 < mean.poses[0, 0]


def detections(*rows: tuple[list[float], float, list[float]]) -> Detections:
    boxes, scores, poses = (np.array(values, dtype=float) for values in zip(*rows, strict=True))
    return Detections(boxes, scores, poses)


NOTHING = Detections(np.empty((0, 4)), np.empty(0), np.empty((0, 5)))


def test_means_by_hand() -> None:
    one = detections(
        ([0, 0, 10, 10], 0.9, [1, 0, 20, 90, 350]),
        ([0, 0, 10, 9], 0.5, [50, 50, 50, 10, 100]),  # the same view sees this shaft better
        ([60, 60, 90, 90], 0.3, [5, 5, 30, 45, 45]),
    )
    other = detections(([0, 0, 13, 10], 0.45, [4, 3, 23, 90, 20]))
    found = mean_detections([one, NOTHING, other])
    np.testing.assert_allclose(found.scores, [0.45, 0.1])
    np.testing.assert_allclose(found.boxes, [[0, 0, 11, 10], [60, 60, 90, 90]])
    np.testing.assert_allclose(found.poses[0, :4], [2, 1, 21, 90])
    # Unit vectors at 350 deg, twice, and at 20 deg: their sum's direction.
    turn = np.radians([350, 350, 20])
    yaw_deg = np.degrees(np.arctan2(np.sin(turn).sum(), np.cos(turn).sum())) % 360
    assert found.poses[0, 4] == pytest.approx(yaw_deg)
    np.testing.assert_allclose(found.poses[1], [5, 5, 30, 45, 45])


def test_a_view_that_turns_a_shaft_round_changes_no_pose() -> None:
    right, turned = ([0, 0, 20, 60, 30], [9, 9, 30, 120, 210])
    views = [detections(([0, 0, 9, 9], score, right)) for score in (0.4, 0.2)]
    found = mean_detections([detections(([0, 0, 9, 9], 0.5, turned)), *views])
    np.testing.assert_allclose(found.poses, [right])
    np.testing.assert_allclose(found.scores, [1.1 / 3])


def test_little_overlap_is_another_shaft() -> None:
    views = [
        detections(([0, 0, 10, 10], 0.9, [0, 0, 20, 60, 0])),
        detections(([0, 0, 10, 17], 0.5, [0, 0, 20, 60, 0])),  # IoU 0.588
    ]
    np.testing.assert_allclose(mean_detections(views).scores, [0.45, 0.25])


def test_nothing_is_found_where_no_view_shows_anything() -> None:
    found = mean_detections([NOTHING] * 8)
    assert (found.boxes.shape, found.scores.shape, found.poses.shape) == ((0, 4), (0,), (0, 5))


def test_a_box_without_an_area_ends() -> None:
    flat = detections(([5, 5, 5, 5], 0.5, [0, 0, 20, 60, 0]))
    np.testing.assert_allclose(mean_detections([flat, flat]).scores, [0.25, 0.25])
