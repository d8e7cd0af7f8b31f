"""Errors in a film, frame by frame."""

from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from shaftpose.core.geometry import ShaftPose
from shaftpose.settings.compose import composed_settings
from studies.film_results import changes, film_errors
from studies.moving_shafts import HEIGHT, OVERRIDES, WIDTH, poses_at

ROOT = Path(__file__).parents[2]


def stated(x_mm: float, yaw_deg: float) -> dict[str, float]:
    return asdict(ShaftPose(x_mm, 0, 20, 70, yaw_deg))


def test_each_shaft_is_compared_with_its_own_pose() -> None:
    true = [[stated(-5, 180), stated(5, 359)]] * 2
    found = [[stated(5.5, 1), stated(-5, 178)], [stated(-4, 180)]]
    errors = film_errors(true, found)
    assert {key: error.round(6).tolist() for key, error in errors.items()} == {
        (0, 0): [0, 0, 0, 0, -2],
        (0, 1): [0.5, 0, 0, 0, 2],
        (1, 0): [1, 0, 0, 0, 0],
    }
    # Only the first shaft is in both frames.
    assert changes(errors).tolist() == pytest.approx([1, 0, 0, 0, 2])


def test_the_shafts_stay_where_the_model_knows_them() -> None:
    """All poses of the film are within the ranges that models are trained for."""
    ranges = composed_settings(ROOT).rendering.poses
    low, high = np.array([ranges.x_mm, ranges.y_mm, ranges.z_mm, ranges.pitch_deg, (0, 360)]).T
    poses = np.array([pose.as_array() for n in range(500) for pose in poses_at(n / 25)])
    assert np.all((poses >= low) & (poses < high))


def test_tips_leave_the_central_square_and_stay_in_the_frame() -> None:
    camera = composed_settings(ROOT, *OVERRIDES).rendering.camera
    focal_px = WIDTH / 2 / np.tan(np.radians(camera.view_deg / 2))
    poses = np.array([[pose.tip_mm for pose in poses_at(n / 25)] for n in range(100)])
    x, y = np.moveaxis(focal_px * poses[..., :2] / poses[..., 2:], -1, 0)
    assert np.all(np.abs(x) < WIDTH / 2) and np.all(np.abs(y) < HEIGHT / 2)
    assert np.mean(np.abs(x) > HEIGHT / 2, axis=0).min() > 0.1
