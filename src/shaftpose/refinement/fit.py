"""Fit of one pose to the edges of a mask and of an image."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from shaftpose.core.angles import signed_deg, unsigned_deg
from shaftpose.core.geometry import Camera
from shaftpose.refinement.contour import Array, Contour, Shaft, shaft_contour
from shaftpose.refinement.edges import Offsets

_LARGEST_STEP = np.array([2.0, 2.0, 4.0, 10.0, 10.0])
# Standard deviation of the offset of an edge 1 px long; of one n px long, it is this by root n.
# Neighbours share their errors, so it is larger than that of a single sample.
EDGE_PX = 1.0
_LEAST_SAMPLES = 8

Search = Callable[[Contour, float], Offsets]


class Fit(NamedTuple):
    """A fitted pose (5,) mm, deg; its covariance (5, 5); the mean contrast along its contour; why
    it is the start, "" if it is not."""

    pose: Array
    covariance: Array
    contrast: float
    kept: str = ""


def fit_pose(
    start: Array,
    shaft: Shaft,
    camera: Camera,
    search: Search,
    reaches_px: Sequence[float],
    prior: Array,
) -> Fit:
    """The pose whose contour lies on the edges that `search` finds within each reach in turn.

    Gauss-Newton on the offsets along the contour's normals, each weighted by how clear the edge is
    and how near; `prior` (5,), standard deviations of the start, holds what edges leave open.
    """
    pose, precision, contrast = start, np.diag(prior**-2.0), 0.0
    information = precision
    for reach_px in reaches_px:
        contour = shaft_contour(pose, shaft, camera)
        if len(contour.points) < _LEAST_SAMPLES:
            return Fit(start, np.diag(prior**2.0), 0.0, "no contour in view")
        offsets = search(contour, reach_px)
        if np.sum(offsets.weights > 0.01) < _LEAST_SAMPLES:
            return Fit(start, np.diag(prior**2.0), 0.0, "too few edges")
        weighted = contour.motion.T * (offsets.weights * contour.lengths / EDGE_PX**2)
        information = weighted @ contour.motion + precision
        away = start - pose
        away[4] = signed_deg(away[4])
        step = np.linalg.solve(information, weighted @ offsets.px + precision @ away)
        if not np.isfinite(step).all():
            return Fit(start, np.diag(prior**2.0), 0.0, "no solution")
        pose = pose + np.clip(step, -_LARGEST_STEP, _LARGEST_STEP)
        contrast = float(offsets.contrast.mean())
    pose = np.append(pose[:4], unsigned_deg(pose[4]))
    return Fit(pose, np.linalg.inv(information), contrast)
