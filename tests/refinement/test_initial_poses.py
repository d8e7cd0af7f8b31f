"""Initial poses of the shafts that a mask shows and no detection explains."""

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.cylinder import cylinder_depth
from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.core.instruments import Detections
from shaftpose.refinement.contour import Array, Shaft
from shaftpose.refinement.initial_poses import initial_poses_from_mask
from shaftpose.refinement.refiner import Refiner

SHAFT = Shaft(3.0)
CAMERA = Camera.from_field_of_view(299, 299, 95.0)
FIRST = np.array([-6.0, -4.0, 20.0, 70.0, 200.0])
SECOND = np.array([7.0, 5.0, 25.0, 65.0, 30.0])
NOTHING = Detections(np.empty((0, 4)), np.empty(0), np.empty((0, 5)))
RGB = np.zeros((299, 299, 3), np.uint8)


def mask_of(*poses: Array) -> NDArray[np.float32]:
    shown = [
        np.isfinite(cylinder_depth(CAMERA, ShaftPose.from_array(pose), 3.0, 150.0))
        for pose in poses
    ]
    return np.any(shown, axis=0).astype(np.float32)


def test_a_start_is_near_the_shaft_that_it_stands_for() -> None:
    starts = initial_poses_from_mask(mask_of(FIRST), [], SHAFT, CAMERA)
    assert starts[:, 3].tolist() == [60, 85]
    for start in starts:
        tips = CAMERA.project(np.stack([start[:3], FIRST[:3]]))
        assert np.linalg.norm(tips[0] - tips[1]) < 10
        assert abs(start[4] - FIRST[4]) < 5
        assert 0.7 < start[2] / FIRST[2] < 1.3


def test_a_detected_shaft_is_explained() -> None:
    both = mask_of(FIRST, SECOND)
    assert len(initial_poses_from_mask(both, [FIRST, SECOND], SHAFT, CAMERA)) == 0
    (start, _) = initial_poses_from_mask(both, [FIRST], SHAFT, CAMERA)
    assert abs(start[4] - SECOND[4]) < 5


def test_small_round_and_thin_regions_are_no_shafts() -> None:
    mask = np.zeros((299, 299), np.float32)
    mask[20:35, 20:35] = 1  # too small
    mask[100:140, 100:140] = 1  # as wide as long
    mask[200:204, 20:280] = 1  # thinner than the opening
    assert initial_poses_from_mask(mask, [], SHAFT, CAMERA).shape == (0, 5)
    assert initial_poses_from_mask(0 * mask, [], SHAFT, CAMERA).shape == (0, 5)


def test_the_refiner_finds_what_only_the_mask_shows() -> None:
    found = Refiner(SHAFT, None)(RGB, mask_of(FIRST), NOTHING, CAMERA)
    assert len(found.scores) == 1
    assert 0.4 < found.scores[0] < 0.6  # the cube root of 0.2 is 0.58
    assert np.all(np.abs(found.poses[0] - FIRST) < [0.2, 0.2, 0.6, 2.0, 1.0])
    assert np.isfinite(found.deviations).all()


def test_a_tip_that_is_not_flat_has_no_box_and_is_not_looked_for() -> None:
    pointed = Refiner(SHAFT._replace(flat_tip=False), None)
    assert len(pointed(RGB, mask_of(FIRST), NOTHING, CAMERA).scores) == 0
