"""A pose as the five parameters in which it is fitted.

They are the tip in the image (px, px), the logarithm of its depth, pitch and yaw (deg).
"""

import numpy as np

from shaftpose.core.geometry import Camera, axis_direction, signed_deg, unsigned_deg
from shaftpose.refinement.contour import Array


def parameters(pose: Array, camera: Camera) -> Array:
    """The parameters (5,) of a pose (5,) mm, deg."""
    return np.array([*camera.project(pose[:3]), np.log(pose[2]), *pose[3:]])


def derivatives(pose: Array, camera: Camera) -> Array:
    """Derivatives (5, 5) of a pose, mm and deg, by its parameters, px, 1 and deg."""
    spread = np.eye(5)
    spread[[0, 1], [0, 1]] = pose[2] / camera.focal_px
    spread[:3, 2] = pose[:3]
    return spread


def moved(pose: Array, step: Array, camera: Camera) -> Array:
    """The pose (5,) after a step (5,) of the parameters; pitches stay in [0, 180] deg."""
    u, v, log_depth, pitch, yaw = parameters(pose, camera) + step
    if not 0 <= pitch <= 180:  # the axis has passed the line of sight
        pitch, yaw = abs(signed_deg(float(pitch))), yaw + 180
    depth = np.exp(log_depth)
    x, y = camera.lift(np.array([u, v]), depth)
    return np.array([x, y, depth, pitch, unsigned_deg(float(yaw))])


def with_pitch(pose: Array, pitch_deg: float) -> Array:
    """The pose with another pitch, and the yaw with which its axis has the same image.

    If no axis with this pitch has the image, it is the one nearest to the plane of those that have.
    """
    # Such axes are normal to the plane's normal n: n_x cos(yaw) + n_y sin(yaw) = n_z / tan(pitch).
    normal = np.cross(pose[:3], axis_direction(pose[3], pose[4]))
    pitch, across = np.radians(pitch_deg), float(np.hypot(normal[0], normal[1]))
    share = normal[2] * np.cos(pitch) / max(across * np.sin(pitch), 1e-9)
    lean = np.degrees(np.arccos(np.clip(share, -1.0, 1.0)))
    middle = np.degrees(np.arctan2(normal[1], normal[0]))
    turns = [signed_deg(float(middle + turn - pose[4])) for turn in (lean, -lean)]
    return np.array([*pose[:3], pitch_deg, unsigned_deg(float(pose[4] + min(turns, key=abs)))])
