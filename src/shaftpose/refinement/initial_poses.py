"""Poses from which fits start: near a network's pose, and on straight runs of a mask.

Where a tip is hidden, lies outside the image or continues in jaws, a network's heat map often
misses it, while the mask still shows the shaft.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.geometry import Camera, axis_direction, projected_axes, unsigned_deg
from shaftpose.refinement.contour import Array, Shaft
from shaftpose.refinement.pose_parameters import with_pitch
from shaftpose.refinement.straight_runs import Run

_PITCHES_DEG = (60.0, 85.0)  # if those of the training are unknown
_OFF, _OFF_PX = 0.25, 3.0  # widths: an axis so near to both ends of a run is the run's
_PLACE = 0.7  # of a run, from its tip: where its width tells the depth; near a tip there are jaws


class Start(NamedTuple):
    """An initial pose (5,) of a fit. prior_pose: (5,), the mean of the fit's prior."""

    pose: Array
    prior_pose: Array


def starts_at(pose: Array, pitches_deg: Sequence[float] | None) -> list[Start]:
    """Starts at a known pose (5,) with several pitches, as a network is least sure of the pitch;
    None: with its own."""
    if pitches_deg is None:
        return [Start(pose, pose)]
    return [Start(with_pitch(pose, pitch), pose) for pitch in pitches_deg]


def starts_on(
    run: Run, pitches_deg: Sequence[float] | None, shaft: Shaft, camera: Camera
) -> list[Start]:
    """Starts with several pitches on a run; of each, nothing else was known."""
    pitches = _PITCHES_DEG if pitches_deg is None else pitches_deg
    poses = [pose_of(run, pitch, shaft, camera) for pitch in pitches]
    return [Start(pose, pose) for pose in poses]


def lying_on(
    poses: Array, runs: Sequence[Run], camera: Camera, widths: float = _OFF
) -> NDArray[np.bool_]:
    """Whether poses (K, 5) lie on runs, (R, K): in the same direction, and both ends of the run at
    most `widths` of its widths beside the pose's axis."""
    aside, along = _places(poses, runs, camera)
    return (aside <= widths) & (along > 0)


def first_on(runs: Sequence[Run], poses: Array, camera: Camera) -> NDArray[np.bool_]:
    """Whether each of the poses (K, 5), best first, is the first on all runs that it lies on: (K,).

    Two poses on one run show the same shaft, at two places for its tip.
    """
    on = _places(poses, runs, camera)[0] <= _OFF
    return np.asarray((~on | (np.cumsum(on, axis=1) == 1)).all(axis=0))


def _places(poses: Array, runs: Sequence[Run], camera: Camera) -> tuple[Array, Array]:
    """The larger distance (R, K) of each run's ends from each axis, in the run's widths (of at
    least `_OFF_PX / _OFF` px), and the cosines (R, K) between run and axis."""
    tips, behind = np.moveaxis(projected_axes(poses, camera), 1, 0)
    axes = behind - tips
    axes = axes / np.maximum(np.linalg.norm(axes, axis=1, keepdims=True), 1e-9)
    ends = np.array([run.ends for run in runs]).reshape(-1, 1, 2, 2)
    widths = np.array([run.widths for run in runs]).reshape(-1, 1, 2)
    offsets, across = ends - tips[:, None], axes[:, None]
    aside = np.abs(offsets[..., 0] * across[..., 1] - offsets[..., 1] * across[..., 0])
    directions = np.array([run.direction for run in runs]).reshape(-1, 2)
    places = aside / np.maximum(widths, _OFF_PX / _OFF)
    return places.max(axis=2, initial=0.0), directions @ axes.T


def pose_of(run: Run, pitch_deg: float, shaft: Shaft, camera: Camera) -> Array:
    """The pose (5,) with a pitch of which a run is the image. A tip outside the image is a width
    beyond the end of the run."""
    place = run.ends[0] + _PLACE * (run.ends[1] - run.ends[0])
    width = run.widths[0] + _PLACE * (run.widths[1] - run.widths[0])
    depth = camera.focal_px * shaft.diameter_mm / width
    yaw_deg = unsigned_deg(float(np.degrees(np.arctan2(run.direction[1], run.direction[0]))))
    level = np.array([*camera.lift(place, depth), depth, 90.0, yaw_deg])
    inclined = with_pitch(level, pitch_deg)
    end = run.ends[0] - run.outside * run.widths[0] * run.direction
    ray = np.array([*camera.lift(end, 1.0), 1.0])
    # The tip is where the ray through the end meets the axis through the place.
    both = np.column_stack([ray, axis_direction(inclined[3], inclined[4])])
    z_mm = np.linalg.lstsq(both, inclined[:3], rcond=None)[0][0]
    return np.array([*(z_mm * ray), *inclined[3:]])
