"""Shafts followed from frame to frame."""

import numpy as np

from shaftpose.core.geometry import ShaftPose
from shaftpose.inference.found_shafts import FoundShaft
from shaftpose.inference.frames import Frame
from shaftpose.inference.tracker import Tracker, matches

RGB = np.zeros((10, 20, 3), np.uint8)
DRAWN = np.ones((2, 2))


def frame(number: int, source: str = "film.mp4", fps: float | None = 25.0) -> Frame:
    return Frame(source, number, RGB, fps)


def shaft(x_mm: float, yaw_deg: float = 0.0) -> FoundShaft:
    pose = ShaftPose(x_mm, 0, 20, 80, yaw_deg % 360)
    return FoundShaft(0.9, np.zeros(4), np.zeros((2, 2)), pose, True, np.full(5, 0.1))


def tracker() -> Tracker:
    return Tracker(lambda pose, rgb: DRAWN)


def test_shafts_that_pass_each_other_keep_their_numbers() -> None:
    """Two tips meet in frame 25, coming from both sides, with opposite axes."""
    follow = tracker()
    for n in range(50):
        left, right = shaft(-10 + 0.4 * n, 180), shaft(10 - 0.4 * n, 0)
        found = follow(frame(n), [left, right] if n % 2 else [right, left])
        by_axis = {round(one.pose.yaw_deg / 180) % 2: one.track for one in found}
        assert by_axis == {0: 1, 1: 2}


def test_a_shaft_that_was_away_for_long_is_a_new_one() -> None:
    follow = tracker()
    assert [one.track for one in follow(frame(0), [shaft(0)])] == [1]
    assert follow(frame(5), []) == []
    assert [one.track for one in follow(frame(12), [shaft(0.5)])] == [1]
    assert [one.track for one in follow(frame(26), [shaft(0.5)])] == [2]


def test_numbers_begin_again_with_each_video() -> None:
    follow = tracker()
    for source in ("a.mp4", "b.mp4"):
        for n in range(3):
            assert [one.track for one in follow(frame(n, source), [shaft(0)])] == [1]


def test_a_smoothed_pose_is_drawn_where_it_is() -> None:
    (found,) = tracker()(frame(0), [shaft(3)])
    assert found.axis_px is DRAWN
    assert found.deviations is not None and found.deviations.tolist() == [0.1] * 5


def test_images_are_left_alone() -> None:
    one = shaft(3)
    assert tracker()(frame(0, "image.png", None), [one]) == [one]


def test_the_nearest_pairs_match_first_and_far_ones_never() -> None:
    along = np.array([0.0, 0, 0, 1, 0, 0])
    at = [along + np.array([x, 0, 0, 0, 0, 0]) for x in (0.0, 4.0, 30.0)]
    assert matches(at, [at[1] - 3 * np.eye(6)[0], at[1]]) == {1: 1, 0: 0}
    assert matches(at[2:], at[:1]) == {}
    assert matches([along], [np.array([0.0, 0, 0, 0, 1, 0])]) == {}
