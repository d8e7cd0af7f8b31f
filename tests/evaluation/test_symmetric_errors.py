"""ADD-S, MSSD and MSPD on pairs of poses whose errors follow from geometry."""

import numpy as np
import pytest

from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.evaluation.symmetric_errors import MODEL_MM, symmetric_errors

CAMERA = Camera(width=300, height=300, focal_px=100.0, cx=150.0, cy=150.0)
ACROSS = np.array([[1.0, 2.0, 50.0, 90.0, 0.0]])  # the axis is the camera's x


def errors(predicted: np.ndarray, true: np.ndarray = ACROSS) -> tuple[float, float, float]:
    found = symmetric_errors(predicted, true, 3.0, [CAMERA] * len(true))
    return float(found.add_s_mm[0]), float(found.mssd_mm[0]), float(found.mspd_px[0])


def test_equal_poses_have_no_errors() -> None:
    np.testing.assert_allclose(errors(ACROSS), 0, atol=1e-12)


def test_a_shift_moves_every_point_alike() -> None:
    add_s, mssd, mspd = errors(ACROSS + [0, 0.5, 0, 0, 0])
    assert mssd == pytest.approx(0.5)
    assert add_s < 0.5  # other points of the rod are closer
    # The nearest points, 1.5 mm before the axis, move most in the image.
    assert mspd == pytest.approx(0.5 * 100 / 48.5, rel=1e-3)


def test_a_turn_about_the_tip_moves_the_far_end() -> None:
    _, mssd, _ = errors(ACROSS + [0, 0, 0, 0, 6])
    # In the plane of the turn, the chord of the far rim's corner: its distance from the tip is the
    # diagonal of length and radius.
    chord = 2 * np.hypot(MODEL_MM, 1.5) * np.sin(np.radians(3))
    assert mssd == pytest.approx(chord, rel=1e-3)


def test_points_behind_the_camera_are_not_projected() -> None:
    near = np.array([[0.0, 0.0, 7.0, 30.0, 0.0]])  # 10 mm up the shaft, z is -1.7 mm
    add_s, mssd, mspd = errors(near + [0, 0.1, 0, 0, 0], near)
    assert mssd == pytest.approx(0.1)
    assert 0.1 * 100 / 8 < mspd < 0.1 * 100 / 1


def test_rotations_about_the_axis_do_not_count() -> None:
    """Against a search over finer rotations than the model has corners."""
    rng = np.random.default_rng(5)
    for _ in range(5):
        true = np.array([rng.uniform([-5, -5, 20, 55, 0], [5, 5, 35, 85, 358])])
        predicted = true + rng.normal(0, [0.5, 0.5, 1, 3, 3])
        angles = np.linspace(0, 2 * np.pi, 65)[:-1]
        rim = np.concatenate([
            np.column_stack([1.5 * np.cos(angles), 1.5 * np.sin(angles), np.full(64, z)])
            for z in (0.0, MODEL_MM)
        ])  # fmt: skip
        found, known = (ShaftPose.from_array(pose[0]) for pose in (predicted, true))
        at = rim @ known.rotation.T + known.tip_mm
        least = min(
            np.linalg.norm(rim @ found.rolled(roll).T + found.tip_mm - at, axis=1).max()
            for roll in np.arange(0, 360, 0.5)
        )
        assert errors(predicted, true)[1] == pytest.approx(least, rel=0.03)
