import numpy as np
import pytest

from shaftpose.core.geometry import axis_direction, projected_axes
from shaftpose.refinement.pose_parameters import derivatives, moved, parameters, with_pitch
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


def image_angle_deg(pose: np.ndarray) -> float:
    ((tip, behind),) = projected_axes(pose[None], CAMERA)
    return float(np.degrees(np.arctan2(*(behind - tip)[::-1])))


@pytest.mark.parametrize("pitch_deg", [40.0, 75.0, 90.0, 105.0])
def test_with_another_pitch_a_shaft_keeps_its_image_of_the_axis(pitch_deg: float) -> None:
    for pose in POSES:
        turned = with_pitch(pose, pitch_deg)
        assert turned[:4] == pytest.approx([*pose[:3], pitch_deg])
        assert image_angle_deg(turned) == pytest.approx(image_angle_deg(pose), abs=1e-6)


def test_on_the_optical_axis_the_yaw_stays() -> None:
    pose = np.array([0.0, 0.0, 20.0, 70.0, 215.0])
    assert with_pitch(pose, 30.0) == pytest.approx([0, 0, 20, 30, 215])


def test_if_no_axis_has_the_image_the_nearest_one_is_taken() -> None:
    """Seen from the left, steep axes towards the camera all seem to point to the right."""
    up = np.array([20.0, 0.0, 20.0, 90.0, 270.0])
    assert with_pitch(up, 20.0)[3:] == pytest.approx([20, 180])
    assert np.isfinite(with_pitch(up, 0.0)).all()
