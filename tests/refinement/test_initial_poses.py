"""Starts of fits near detections and on the runs of a mask, and the shafts found from them."""

import numpy as np
import pytest
from numpy.typing import NDArray

from shaftpose.core.cylinder import cylinder_depth
from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.core.instruments import Detections
from shaftpose.refinement.contour import Array, Shaft
from shaftpose.refinement.initial_poses import first_on, lying_on, pose_of, starts_at, starts_on
from shaftpose.refinement.refiner import Refiner
from shaftpose.refinement.straight_runs import Run, straight_runs

SHAFT = Shaft(3.0)
CAMERA = Camera.from_field_of_view(299, 299, 95.0)
FIRST = np.array([-6.0, -4.0, 20.0, 70.0, 200.0])
SECOND = np.array([7.0, 5.0, 25.0, 65.0, 30.0])
CROSSING = np.array([-14.0, 5.0, 22.0, 75.0, 275.0])  # crosses the first
NOTHING = Detections(np.empty((0, 4)), np.empty(0), np.empty((0, 5)))
RGB = np.zeros((299, 299, 3), np.uint8)


def mask_of(*poses: Array) -> NDArray[np.float32]:
    shown = [
        np.isfinite(cylinder_depth(CAMERA, ShaftPose.from_array(pose), 3.0, 150.0))
        for pose in poses
    ]
    return np.any(shown, axis=0).astype(np.float32)


def test_starts_at_a_pose_have_its_tip_and_several_pitches() -> None:
    starts = starts_at(FIRST, [50.0, 80.0])
    assert all(start.prior_pose is FIRST for start in starts)
    assert [start.pose[3] for start in starts] == [50, 80]
    assert all((start.pose[:3] == FIRST[:3]).all() for start in starts)
    assert starts_at(FIRST, None) == [(FIRST, FIRST)]


def test_a_level_shaft_of_constant_width_is_as_deep_as_its_width_tells() -> None:
    """30 px wide at a focal length of 137 px, 3 mm are 13.7 mm away."""
    run = Run(np.array([[149.5, 100.0], [0.0, 100.0]]), np.array([30.0, 30.0]))
    focal_px = 149.5 / np.tan(np.radians(47.5))
    depth = focal_px * 3 / 30
    expected = [0, -49.5 / focal_px * depth, depth, 90, 180]
    assert pose_of(run, 90.0, SHAFT, CAMERA) == pytest.approx(expected)


def test_of_an_inclined_shaft_the_depth_follows_from_its_width_far_from_the_tip() -> None:
    (run,) = straight_runs(mask_of(FIRST), CAMERA)
    pose = pose_of(run, 70.0, SHAFT, CAMERA)
    tips = CAMERA.project(np.stack([pose[:3], FIRST[:3]]))
    assert np.linalg.norm(tips[0] - tips[1]) < 8
    assert pose[4] == pytest.approx(FIRST[4], abs=4)
    assert pose[2] == pytest.approx(FIRST[2], rel=0.1)
    assert [start.pose[3] for start in starts_on(run, None, SHAFT, CAMERA)] == [60, 85]


def test_a_tip_outside_is_a_width_beyond_the_border() -> None:
    run = Run(np.array([[0.0, 100.0], [299.0, 100.0]]), np.array([30.0, 30.0]), outside=True)
    assert CAMERA.project(pose_of(run, 90.0, SHAFT, CAMERA)[:3]) == pytest.approx([-30, 100])


def test_an_axis_lies_on_a_run_if_it_passes_both_ends() -> None:
    runs = [*straight_runs(mask_of(FIRST), CAMERA), *straight_runs(mask_of(SECOND), CAMERA)]
    behind = np.array([-12.0, -6.2, 17.7, 70.0, 200.0])  # on the first shaft, far from its tip
    turned = FIRST + [0, 0, 0, 0, 25.0]
    on = lying_on(np.array([FIRST, behind, turned, SECOND]), runs, CAMERA)
    assert on.tolist() == [[True, True, False, False], [False, False, False, True]]
    assert lying_on(np.empty((0, 5)), runs, CAMERA).shape == (2, 0)
    assert lying_on(np.array([FIRST]), [], CAMERA).shape == (0, 1)
    (run,) = straight_runs(mask_of(FIRST), CAMERA)
    back = run._replace(ends=run.ends[::-1], widths=run.widths[::-1])  # its tip at the border
    assert not lying_on(np.array([FIRST]), [back], CAMERA).any()
    nearly = FIRST + [0, 0, 0, 0, 6.0]  # aside at the border
    assert not lying_on(np.array([nearly]), runs, CAMERA)[0, 0]
    assert lying_on(np.array([nearly]), runs, CAMERA, 0.5)[0, 0]


def test_of_two_tips_on_one_run_the_better_one_stays() -> None:
    runs = [*straight_runs(mask_of(FIRST), CAMERA), *straight_runs(mask_of(SECOND), CAMERA)]
    behind = np.array([-12.0, -6.2, 17.7, 70.0, 200.0])  # on the first shaft, far from its tip
    beside = FIRST + [0, 0, 0, 0, 25.0]  # on no run
    poses = np.array([behind, SECOND, beside, FIRST, SECOND])
    assert first_on(runs, poses, CAMERA).tolist() == [True, True, True, False, False]
    assert first_on([], poses, CAMERA).all()
    reversed_runs = [
        run._replace(ends=run.ends[::-1]) for run in runs
    ]  # the same shaft all the same
    assert not first_on(reversed_runs, poses, CAMERA)[3]


@pytest.mark.parametrize("pitches_deg", [None, (50.0, 90.0)])
def test_the_refiner_finds_what_only_the_mask_shows(pitches_deg: tuple[float, float]) -> None:
    found = Refiner(SHAFT, None, pitches_deg)(RGB, mask_of(FIRST), NOTHING, CAMERA)
    assert len(found.scores) == 1
    assert 0.75 < found.scores[0] < 0.85  # the eighth root of 0.2 is 0.82
    assert np.all(np.abs(found.poses[0] - FIRST) < [0.2, 0.2, 0.6, 2.0, 1.0])
    assert np.isfinite(found.deviations).all()


def test_the_refiner_finds_shafts_that_cross() -> None:
    found = Refiner(SHAFT, None)(RGB, mask_of(FIRST, CROSSING), NOTHING, CAMERA)
    assert len(found.scores) == 2
    for pose in (FIRST, CROSSING):
        errors = np.abs(found.poses - pose)
        assert (errors < [0.5, 0.5, 1.5, 5.0, 3.0]).all(axis=1).any()


def test_a_detection_explains_its_run_and_is_less_sure_without_one() -> None:
    detected = Detections(np.zeros((1, 4)), np.ones(1), FIRST[None])
    refiner = Refiner(SHAFT, None)
    both = refiner(RGB, mask_of(FIRST, SECOND), detected, CAMERA)
    assert len(both.scores) == 2
    assert both.scores[0] > 0.9 > both.scores[1]
    short = mask_of(FIRST)
    short[:, :80] = 0  # no longer than it is wide
    assert refiner(RGB, short, detected, CAMERA).scores[0] < 0.8


def test_a_tip_that_is_not_flat_has_no_box_and_is_not_looked_for() -> None:
    pointed = Refiner(SHAFT._replace(flat_tip=False), None)
    assert len(pointed(RGB, mask_of(FIRST), NOTHING, CAMERA).scores) == 0
