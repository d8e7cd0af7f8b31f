"""A Kalman filter for the motion of one shaft."""

import numpy as np

from shaftpose.core.geometry import Array, ShaftPose, pose_along

# Power spectral densities of the accelerations that the filter expects: of the tip in mm^2 / s^3,
# of the axis in rad^2 / s^3. Working hands reach some 100 mm / s^2.
_TIP_DENSITY, _AXIS_DENSITY = 2000.0, 1.0
# Standard deviations of the initial velocity: mm / s, rad / s.
_FIRST_TIP_SPEED, _FIRST_AXIS_SPEED = 50.0, 1.0
# Squared Mahalanobis distance above which a measurement, probably an outlier, counts less.
_FAR = 16.0
_RADIAL = 1e-3  # standard deviation of the length of a measured axis; the length is 1


class Measurement:
    """A pose (tip in mm, unit vector along the axis) with its covariance (6, 6).

    deviations: (5,) standard deviations of the pose, mm and deg. along_mm: another one of the tip,
    along the axis.
    """

    def __init__(self, pose: ShaftPose, deviations: Array, along_mm: float = 0.0) -> None:
        self.values = tip_and_axis(pose)
        turned = axis_derivatives(pose) * np.radians(deviations[3:])
        self.covariance = np.zeros((6, 6))
        along = along_mm * pose.direction
        self.covariance[:3, :3] = np.diag(deviations[:3] ** 2) + np.outer(along, along)
        self.covariance[3:, 3:] = turned @ turned.T + _RADIAL**2 * np.eye(3)


class Track:
    """The state of one shaft, which moves at constant velocity except for random accelerations.

    The state (12,) consists of the tip, the axis and their velocities. The axis is a unit vector
    rather than angles, which would jump at 360 deg. time_s: of the last measurement.
    """

    def __init__(self, number: int, first: Measurement, time_s: float) -> None:
        self.number, self.time_s = number, time_s
        self._state = np.concatenate([first.values, np.zeros(6)])
        self._covariance = np.zeros((12, 12))
        self._covariance[:6, :6] = first.covariance
        speeds = [_FIRST_TIP_SPEED] * 3 + [_FIRST_AXIS_SPEED] * 3
        self._covariance[6:, 6:] = np.diag(np.square(speeds))

    def predicted(self, time_s: float) -> Array:
        """(6,) predicted tip and axis at a time."""
        state = self._state[:6] + (time_s - self.time_s) * self._state[6:]
        return np.concatenate([state[:3], state[3:] / np.linalg.norm(state[3:])])

    def update(self, seen: Measurement, time_s: float) -> None:
        """Predict to the time of a measurement, and correct the state by it."""
        self._advance(time_s)
        prior = self._covariance[:6, :6]
        error = seen.values - self._state[:6]
        distance = float(error @ np.linalg.solve(prior + seen.covariance, error))
        noise = seen.covariance * max(1.0, distance / _FAR)
        gain = self._covariance[:, :6] @ np.linalg.inv(prior + noise)
        self._state = self._state + gain @ error
        self._covariance = self._covariance - gain @ self._covariance[:6]
        self._state[3:6] /= np.linalg.norm(self._state[3:6])

    def pose(self) -> ShaftPose:
        """The pose after the last update."""
        return pose_along(self._state[3:6], self._state[:3])

    def _advance(self, time_s: float) -> None:
        step = time_s - self.time_s
        motion = np.eye(12)
        motion[:6, 6:] = step * np.eye(6)
        density = np.diag([_TIP_DENSITY] * 3 + [_AXIS_DENSITY] * 3)
        # The integral of white acceleration over the step.
        growth = np.array([[step**3 / 3, step**2 / 2], [step**2 / 2, step]])
        self._state = motion @ self._state
        self._covariance = motion @ self._covariance @ motion.T + np.kron(growth, density)
        self.time_s = time_s


def tip_and_axis(pose: ShaftPose) -> Array:
    """(6,) the tip in mm and the unit vector along the axis."""
    return np.concatenate([pose.tip_mm, pose.direction])


def axis_derivatives(pose: ShaftPose) -> Array:
    """(3, 2) derivatives of the axis by pitch and yaw, in rad."""
    by_pitch, across, _ = pose.rotation.T
    return np.stack([by_pitch, -np.sin(np.radians(pose.pitch_deg)) * across], axis=1)
