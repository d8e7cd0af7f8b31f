import numpy as np
import pytest

from shaftpose.core.geometry import axis_direction
from shaftpose.refinement.pose_parameters import derivatives, moved, parameters
from tests.core.silhouettes import CAMERA, POSES


def test_parameters_of_a_pose() -> None:
    focal_px = 149.5 / np.tan(np.radians(47.5))  # 299 px show 95 deg
    found = parameters(np.array([4.0, -2.0, 20.0, 70.0, 30.0]), CAMERA)
    expected = [149.5 + focal_px / 5, 149.5 - focal_px / 10, np.log(20), 70, 30]
    assert found == pytest.approx(expected)


def test_no_step_leaves_a_pose_as_it_is() -> None:
    for pose in POSES:
        assert moved(pose, np.zeros(5), CAMERA) == pytest.approx(pose)


def test_derivatives_are_those_of_small_steps() -> None:
    for pose in POSES:
        steps = 1e-5 * np.eye(5)
        differences = [(moved(pose, s, CAMERA) - moved(pose, -s, CAMERA)) / 2e-5 for s in steps]
        np.testing.assert_allclose(derivatives(pose, CAMERA), np.transpose(differences), atol=1e-6)


@pytest.mark.parametrize(
    ("pitch_deg", "step_deg", "pitch_after", "yaw_after"),
    [(3.0, -10.0, 7.0, 190.0), (175.0, 10.0, 175.0, 190.0), (90.0, 5.0, 95.0, 10.0)],
)
def test_past_the_line_of_sight_the_axis_turns_round(
    pitch_deg: float, step_deg: float, pitch_after: float, yaw_after: float
) -> None:
    pose = np.array([1.0, 2.0, 20.0, pitch_deg, 10.0])
    after = moved(pose, np.array([0.0, 0.0, 0.0, step_deg, 0.0]), CAMERA)
    assert after[3:] == pytest.approx([pitch_after, yaw_after])
    # The angles, in their ranges, mean the axis that a plain sum gives.
    assert axis_direction(*after[3:]) == pytest.approx(axis_direction(pitch_deg + step_deg, 10.0))
