"""Poses from which fits start, on the shafts that a mask shows and no detection explains."""

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.cylinder import cylinder_depth
from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.core.instruments import Detections
from shaftpose.refinement.contour import Array, Shaft
from shaftpose.refinement.initial_poses import starts_at, starts_on_mask
from shaftpose.refinement.refiner import Refiner

SHAFT = Shaft(3.0)
CAMERA = Camera.from_field_of_view(299, 299, 95.0)
FIRST = np.array([-6.0, -4.0, 20.0, 70.0, 200.0])
SECOND = np.array([7.0, 5.0, 25.0, 65.0, 80.0])
NOTHING = Detections(np.empty((0, 4)), np.empty(0), np.empty((0, 5)))
RGB = np.zeros((299, 299, 3), np.uint8)


def mask_of(*poses: Array) -> NDArray[np.float32]:
    shown = [
        np.isfinite(cylinder_depth(CAMERA, ShaftPose.from_array(pose), 3.0, 150.0))
        for pose in poses
    ]
    return np.any(shown, axis=0).astype(np.float32)


def explained(*poses: Array) -> Array:
    return np.array(poses).reshape(-1, 5)


def test_a_known_pose_is_turned_to_each_pitch_about_its_image() -> None:
    starts = starts_at(FIRST, [60.0, 80.0])
    assert starts.known is FIRST and [pose[3] for pose in starts.poses] == [60, 80]
    assert all(np.array_equal(pose[:3], FIRST[:3]) for pose in starts.poses)
    assert starts_at(FIRST, None).poses[0] is FIRST


def test_starts_are_near_the_shaft_that_they_stand_for() -> None:
    (starts,) = starts_on_mask(mask_of(FIRST), explained(), [60.0, 85.0], SHAFT, CAMERA)
    assert starts.known is None and [pose[3] for pose in starts.poses] == [60, 85]
    for start in starts.poses:
        tips = CAMERA.project(np.stack([start[:3], FIRST[:3]]))
        assert np.linalg.norm(tips[0] - tips[1]) < 10
        assert 0.6 < start[2] / FIRST[2] < 1.4


def test_a_detected_shaft_is_explained() -> None:
    both, pitches = mask_of(FIRST, SECOND), [70.0]
    assert not starts_on_mask(both, explained(FIRST, SECOND), pitches, SHAFT, CAMERA)
    (starts,) = starts_on_mask(both, explained(FIRST), pitches, SHAFT, CAMERA)
    tips = CAMERA.project(np.stack([starts.poses[0][:3], SECOND[:3]]))
    assert np.linalg.norm(tips[0] - tips[1]) < 10


def test_the_refiner_finds_what_only_the_mask_shows() -> None:
    found = Refiner(SHAFT, None)(RGB, mask_of(FIRST), NOTHING, CAMERA)
    assert len(found.scores) == 1
    assert 0.4 < found.scores[0] < 0.6  # the cube root of 0.2 is 0.58
    assert np.all(np.abs(found.poses[0] - FIRST) < [0.2, 0.2, 0.6, 2.0, 1.0])
    assert np.isfinite(found.deviations).all()


def test_a_tip_that_is_not_flat_has_no_box_and_is_not_looked_for() -> None:
    pointed = Refiner(SHAFT._replace(flat_tip=False), None)
    assert len(pointed(RGB, mask_of(FIRST), NOTHING, CAMERA).scores) == 0
