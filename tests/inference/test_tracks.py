"""The Kalman filter of one shaft's motion."""

import numpy as np
import pytest

from shaftpose.core.geometry import ShaftPose
from shaftpose.inference.tracks import Measurement, Track, axis_derivatives

POSE = ShaftPose(3.0, -2.0, 25.0, 70.0, 120.0)
DEVIATIONS = np.array([0.2, 0.3, 1.0, 4.0, 2.0])


def test_the_first_measurement_is_taken_as_it_is() -> None:
    track = Track(1, Measurement(POSE, DEVIATIONS), 0.0)
    assert track.pose().as_array() == pytest.approx(POSE.as_array())


def test_repeated_measurements_at_one_time_are_averaged() -> None:
    track = Track(1, Measurement(POSE, DEVIATIONS), 0.0)
    for x_mm in (3.3, 2.7, 3.4):
        track.update(Measurement(ShaftPose(x_mm, -2, 25, 70, 120), DEVIATIONS), 0.0)
    assert track.pose().x_mm == pytest.approx(np.mean([3.0, 3.3, 2.7, 3.4]))


def test_the_derivatives_of_the_axis() -> None:
    step = 1e-6
    numeric = [
        (turned.direction - POSE.direction) / np.radians(step)
        for turned in (ShaftPose(3, -2, 25, 70 + step, 120), ShaftPose(3, -2, 25, 70, 120 + step))
    ]
    np.testing.assert_allclose(axis_derivatives(POSE), np.array(numeric).T, atol=1e-6)


def test_a_steady_motion_is_followed_and_foreseen() -> None:
    """Through the seam of yaw: 358, 0, 2 deg."""
    deviations = np.full(5, 0.01)
    track = Track(1, Measurement(ShaftPose(0, 0, 20, 70, 340), deviations), 0.0)
    for n in range(1, 26):
        moved = ShaftPose(n * 0.4, 0, 20, 70, (340 + n) % 360)
        track.update(Measurement(moved, deviations), n / 25)
    assert track.pose().x_mm == pytest.approx(10.0, abs=0.02)
    assert track.pose().yaw_deg == pytest.approx(5.0, abs=0.1)
    ahead = track.predicted(27 / 25)
    assert ahead[0] == pytest.approx(10.8, abs=0.05)
    assert ahead[3:] == pytest.approx(ShaftPose(0, 0, 20, 70, 7).direction, abs=0.002)


def test_noise_becomes_less() -> None:
    rng, true, deviations = np.random.default_rng(0), np.array([1.0, 2, 25, 70, 100]), DEVIATIONS
    track = Track(1, Measurement(ShaftPose.from_array(true), deviations), 0.0)
    errors = []
    for n in range(1, 1000):
        seen = true + deviations * rng.standard_normal(5)
        track.update(Measurement(ShaftPose.from_array(seen), deviations), n / 25)
        errors.append(track.pose().as_array() - true)
    left = np.sqrt(np.mean(np.square(errors), axis=0))
    assert np.all(left < [0.95, 0.9, 0.75, 0.7, 0.7] * deviations)


def test_a_gross_error_counts_less() -> None:
    near, far = (Track(1, Measurement(POSE, DEVIATIONS), 0.0) for _ in range(2))
    for n in range(1, 10):
        for track in (near, far):
            track.update(Measurement(POSE, DEVIATIONS), n / 25)
    near.update(Measurement(ShaftPose(3.4, -2, 25, 70, 120), DEVIATIONS), 0.4)
    far.update(Measurement(ShaftPose(11.0, -2, 25, 70, 120), DEVIATIONS), 0.4)
    gain = (near.pose().x_mm - 3) / 0.4
    assert 0 < (far.pose().x_mm - 3) / 8 < gain / 3
