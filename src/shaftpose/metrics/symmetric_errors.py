"""Pose errors of the pose estimation literature, for a rod, which looks alike from all sides.

ADD-S: mean distance from the true model's points to the closest of the estimated model's
(Hinterstoisser et al., 2012). MSSD and MSPD: largest distance of a model's point, in mm and in px
of the image, at the rotation about the axis for which it is least (Hodan et al., BOP challenge
2019). The model is the end of the shaft next to the tip: of the rest, most is out of view, and its
error is the angle of the axis times an arbitrary length.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.metrics.detection.matching import Array

MODEL_MM = 10.0  # length of the model from the tip
_RINGS, _CORNERS = 5, 64
_NEAR_MM = 1.0  # rings that are nearer to the camera in one of both poses are not projected


@dataclass(frozen=True)
class SymmetricErrors:
    """Errors (M,) of M instruments."""

    add_s_mm: Array
    mssd_mm: Array
    mspd_px: Array


def symmetric_errors(
    predicted: Array, true: Array, diameter_mm: float, cameras: Sequence[Camera]
) -> SymmetricErrors:
    """Errors of predicted poses (M, 5) paired with true ones (M, 5), each seen by its camera."""
    model = _model(diameter_mm / 2)
    errors = np.empty((len(true), 3))
    for n, (*pair, camera) in enumerate(zip(predicted, true, cameras, strict=True)):
        found, known = (_placed(model, ShaftPose.from_array(pose)) for pose in pair)
        gaps = np.linalg.norm(known.reshape(-1, 1, 3) - found.reshape(1, -1, 3), axis=-1)
        in_front = np.minimum(found, known)[..., 2].min(axis=1) > _NEAR_MM
        seen = [camera.project(points[in_front]) for points in (found, known)]
        mspd = _largest(*seen) if in_front.any() else np.nan
        errors[n] = gaps.min(axis=1).mean(), _largest(found, known), mspd
    return SymmetricErrors(*errors.T)


def _model(radius_mm: float) -> Array:
    """Points (rings, corners, 3) of a rod's surface in the shaft frame."""
    angles = 2 * np.pi * np.arange(_CORNERS) / _CORNERS
    circle = radius_mm * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    along = np.linspace(0, MODEL_MM, _RINGS)
    return np.stack([np.column_stack([circle, np.full(_CORNERS, z)]) for z in along])


def _placed(model: Array, pose: ShaftPose) -> Array:
    points: Array = model @ pose.rotation.T + pose.tip_mm
    return points


def _largest(found: Array, known: Array) -> float:
    """The largest distance of points (rings, corners, D), at the best turn by whole corners."""
    turned = (np.roll(found, turn, axis=1) for turn in range(_CORNERS))
    return float(min(np.linalg.norm(one - known, axis=-1).max() for one in turned))
