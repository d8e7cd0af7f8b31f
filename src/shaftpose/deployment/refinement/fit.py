"""Fit of one pose to the edges of a mask and of an image."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from shaftpose.core.angles import signed_deg
from shaftpose.core.contour import Array, Contour, Shaft, shaft_contour
from shaftpose.core.fit_parameters import derivatives, moved, parameters
from shaftpose.core.geometry import Camera
from shaftpose.deployment.refinement.edges import Offsets

_LARGEST_STEP = np.array([12.0, 12.0, 0.2, 10.0, 10.0])  # of the parameters
# Standard deviation of the offset of an edge 1 px long; of one n px long, it is this by root n.
# Neighbours share their errors, so it is larger than that of a single sample.
EDGE_PX = 1.0
# Errors on predicted masks are this times those that the edges promise (docs/beyond.md).
UNDERSTATED = 2.0
_LEAST_PX = 10.0  # of clear and near edges

Search = Callable[[Contour, float], Offsets]


class Stage(NamedTuple):
    """One iteration: how far from the contour edges are looked for, and how far from the tip.

    Near the tip a wrong axis displaces the contour less.
    """

    reach_px: float
    length_px: float = np.inf


class Fit(NamedTuple):
    """A fitted pose (5,) mm, deg, and the information (5, 5) about its parameters, of which the
    first two are in pixels of the camera."""

    pose: Array
    information: Array
    camera: Camera

    def covariance(self) -> Array:
        """The covariance (5, 5) of the pose."""
        spread = derivatives(self.pose, self.camera)
        return spread @ np.linalg.inv(self.information) @ spread.T

    def information_in(self, camera: Camera) -> Array:
        """The information about the parameters in pixels of another camera with the same view."""
        scale = np.diag([self.camera.focal_px / camera.focal_px] * 2 + [1.0] * 3)
        return np.asarray(scale @ self.information @ scale)


class _Edges(NamedTuple):
    """Edges along a contour: their offsets (N,) px and information (N,), and how far the contour
    moves across itself with each parameter (N, 5)."""

    offsets: Array
    information: Array
    motion: Array


def fit_pose(
    start: Array,
    shaft: Shaft,
    camera: Camera,
    search: Search,
    stages: Sequence[Stage],
    held: Array,
    centre: Array | None = None,
    understated: float = UNDERSTATED,
) -> Fit | None:
    """The pose whose contour lies on the edges that `search` finds in each stage in turn; None if
    the last stage finds too few.

    Gauss-Newton on the offsets along the contour's normals, each weighted by how clear the edge is
    and how near; `held` (5, 5), the information about the parameters of `centre`, by default the
    start, holds what edges leave open. The errors are taken to be `understated` times those that
    the edges promise.
    """
    if not np.isfinite(start).all() or start[2] <= 0:
        return None
    pose, promised, edges = start, np.zeros_like(held), None
    centre = start if centre is None else centre
    for stage in stages:
        edges = _edges(pose, shaft, camera, search, stage)
        if edges is None:  # perhaps behind an occluder: further from the tip there may be more
            continue
        weighted = edges.motion.T * edges.information
        promised = weighted @ edges.motion
        away = parameters(centre, camera) - parameters(pose, camera)
        away[4] = signed_deg(away[4])
        step = np.linalg.solve(promised + held, weighted @ edges.offsets + held @ away)
        pose = moved(pose, np.clip(step, -_LARGEST_STEP, _LARGEST_STEP), camera)
    if edges is None:
        return None
    return Fit(pose, promised / understated**2 + held / UNDERSTATED**2, camera)


def _edges(
    pose: Array, shaft: Shaft, camera: Camera, search: Search, stage: Stage
) -> _Edges | None:
    """The edges near the contour of a pose; None if they are too few."""
    contour = shaft_contour(pose, shaft, camera)
    if not len(contour.points):
        return None
    offsets = search(contour, stage.reach_px)
    near = np.linalg.norm(contour.points - camera.project(pose[:3]), axis=1) < stage.length_px
    weights = offsets.weights * contour.lengths * near
    if weights.sum() < _LEAST_PX:
        return None
    motion = contour.motion @ derivatives(pose, camera)
    return _Edges(offsets.px, weights / EDGE_PX**2, motion)
