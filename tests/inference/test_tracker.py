"""Shafts followed from frame to frame."""

from dataclasses import replace

import numpy as np

from shaftpose.core.geometry import ShaftPose
from shaftpose.core.images import Image
from shaftpose.frame_sources.frames import Frame
from shaftpose.inference.found_shafts import Array, FoundShaft
from shaftpose.inference.tracker import ShaftTracker, matches

RGB = np.zeros((10, 20, 3), np.uint8)
DRAWN = np.ones((2, 2))


def frame(number: int, source: str = "film.mp4", fps: float = 25.0) -> Frame:
    return Frame(source, number, RGB, number / fps, fps)


def shaft(x_mm: float, yaw_deg: float = 0.0) -> FoundShaft:
    pose = ShaftPose(x_mm, 0, 20, 80, yaw_deg % 360)
    return FoundShaft(0.9, np.zeros(4), np.zeros((2, 2)), pose, True, "seen", np.full(5, 0.1))


def tracker() -> ShaftTracker:
    return ShaftTracker(lambda pose, rgb, aspect: DRAWN, 3.0)


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
    assert follow(frame(13), []) == []
    assert [one.track for one in follow(frame(26), [shaft(0.5)])] == [2]


def test_numbers_begin_again_with_each_video() -> None:
    follow = tracker()
    for source in ("a.mp4", "b.mp4"):
        for n in range(3):
            assert [one.track for one in follow(frame(n, source), [shaft(0)])] == [1]


def test_the_first_shaft_of_the_same_video_again_is_number_one() -> None:
    follow = tracker()
    for _ in range(2):
        assert [one.track for one in follow(frame(0), [shaft(-9)])] == [1]
        assert [one.track for one in follow(frame(1), [shaft(9)])] == [2]


def test_shafts_of_slow_frames_are_followed() -> None:
    """A frame each second."""
    follow = tracker()
    for n in range(5):
        assert [one.track for one in follow(frame(n, fps=1.0), [shaft(0.5 * n)])] == [1]


def test_a_smoothed_pose_is_drawn_where_it_is() -> None:
    drawn: list[ShaftPose] = []

    def axis_px(pose: ShaftPose, rgb: Image, aspect: float) -> Array:
        drawn.append(pose)
        return DRAWN

    follow = ShaftTracker(axis_px, 3.0)
    follow(frame(0), [shaft(3)])
    (found,) = follow(frame(1), [shaft(3.4)])
    assert drawn[-1] == found.pose
    assert 3.1 < found.pose.x_mm < 3.4
    assert found.axis_px is DRAWN
    assert found.deviations is not None and found.deviations.tolist() == [0.1] * 5


def test_distances_grow_with_the_diameter() -> None:
    """A jump of 20 mm is too far for shafts of 3 mm, but not for shafts of 10 mm."""
    for diameter_mm, number in ((3.0, 2), (10.0, 1)):
        follow = ShaftTracker(lambda pose, rgb, aspect: DRAWN, diameter_mm)
        follow(frame(0), [replace(shaft(0), deviations=None)])
        (found,) = follow(frame(1), [replace(shaft(20), deviations=None)])
        assert found.track == number


def test_images_of_a_folder_are_frames_of_a_film() -> None:
    """After the 13th without it, 0.5 s, a shaft is another one."""
    follow = tracker()
    names = [f"a/{n}.png" for n in range(20)]
    found = [
        follow(Frame(name, 0, RGB), [] if 4 < n < 18 else [shaft(0)])
        for n, name in enumerate(names)
    ]
    assert [one.track for shafts in found for one in shafts] == 5 * [1] + 2 * [2]
    assert [one.track for one in follow(Frame("b/0.png", 0, RGB), [shaft(0)])] == [1]


def test_frames_are_as_far_apart_as_their_times() -> None:
    """20 mm in 2 s are no jump; at 25 frames a second they would be one."""
    follow = tracker()
    for number, time_s in enumerate((0.0, 2.0, 4.0)):
        (found,) = follow(Frame("film.mkv", number, RGB, time_s), [shaft(9.0 * number)])
        assert found.track == 1


def test_the_nearest_pairs_match_first_and_far_ones_never() -> None:
    along = np.array([0.0, 0, 0, 1, 0, 0])
    at = [along + np.array([x, 0, 0, 0, 0, 0]) for x in (0.0, 4.0, 30.0)]
    assert matches(at, [at[1] - 3 * np.eye(6)[0], at[1]], 12.0) == {1: 1, 0: 0}
    assert matches(at[2:], at[:1], 12.0) == {}
    assert matches([along], [np.array([0.0, 0, 0, 0, 1, 0])], 12.0) == {}


def test_a_shaft_whose_tip_is_not_seen_is_followed_across_its_axis() -> None:
    """Its tip may lie 12 mm away along the axis; across it, the fit is as exact as ever."""
    follow, across = tracker(), np.array([-np.sqrt(0.5), np.sqrt(0.5), 0.0])
    for n in range(50):
        tip = np.array([0.0, 0.0, 20.0]) + 5 * np.sin(n / 4) * across  # up to 31 mm / s
        pose = ShaftPose.from_array(np.array([*tip, 60.0, 45.0]))
        deviations = np.array([*(0.2 + 12 * abs(pose.direction)), 2.0, 1.0])
        hidden = replace(shaft(0), pose=pose, tip="hidden", deviations=deviations)
        (found,) = follow(frame(n), [hidden])
        assert found.track == 1
        assert abs((found.pose.tip_mm - tip) @ across) < 1.0
