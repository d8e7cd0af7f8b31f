"""Fit of one pose to the edges of a mask and of an image."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.geometry import Camera, signed_deg
from shaftpose.refinement.contour import Array, Contour, Shaft, shaft_contour
from shaftpose.refinement.edges import Offsets
from shaftpose.refinement.fit_parameters import derivatives, moved, parameters

_LARGEST_STEP = np.array([12.0, 12.0, 0.2, 10.0, 10.0])  # of the parameters
_LEAST_PX = 10.0  # of clear and near edges

Search = Callable[[Contour, float], Offsets]


class EdgeErrors(NamedTuple):
    """How edges err along the contour, besides each on its own, which their weights tell.

    shared_px: standard deviation of the offset that all edges on one part of the contour (a line,
    the arc) share; understated: the errors of fitted poses over those that result from both.
    """

    shared_px: float = 0.0
    understated: float = 1.0


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
    """Edges along a contour: their offsets (N,), and how far the contour moves across itself with
    each parameter (N, 5), both in such standard deviations that their errors are independent."""

    offsets: Array
    motion: Array


def fit_pose(
    start: Array,
    shaft: Shaft,
    camera: Camera,
    search: Search,
    stages: Sequence[Stage],
    errors: EdgeErrors,
    held: Array,
    centre: Array | None = None,
) -> Fit | None:
    """The pose whose contour lies on the edges that `search` finds in each stage in turn; None if
    the last stage finds too few.

    Gauss-Newton on the offsets along the contour's normals, each weighted by how clear the edge is
    and how near, which err as `errors` says. `held` (5, 5), the information about the parameters of
    `centre`, by default the start, holds what edges leave open.
    """
    if not np.isfinite(start).all() or start[2] <= 0:
        return None
    pose, promised, edges = start, np.zeros_like(held), None
    centre = start if centre is None else centre
    for stage in stages:
        edges = _edges(pose, shaft, camera, search, stage, errors.shared_px)
        if edges is None:  # perhaps behind an occluder: further from the tip there may be more
            continue
        promised = edges.motion.T @ edges.motion
        away = parameters(centre, camera) - parameters(pose, camera)
        away[4] = signed_deg(away[4])
        step = np.linalg.solve(promised + held, edges.motion.T @ edges.offsets + held @ away)
        pose = moved(pose, np.clip(step, -_LARGEST_STEP, _LARGEST_STEP), camera)
    if edges is None:
        return None
    return Fit(pose, promised / errors.understated**2 + held, camera)


def _edges(
    pose: Array, shaft: Shaft, camera: Camera, search: Search, stage: Stage, shared_px: float
) -> _Edges | None:
    """The edges near the contour of a pose; None if they are too few."""
    contour = shaft_contour(pose, shaft, camera)
    if not len(contour.points):
        return None
    offsets = search(contour, stage.reach_px)
    near = np.linalg.norm(contour.points - camera.project(pose[:3]), axis=1) < stage.length_px
    information = offsets.weights * contour.lengths * near
    if information.sum() < _LEAST_PX:
        return None
    motion = contour.motion @ derivatives(pose, camera)
    both = np.column_stack([offsets.px, motion])
    both = in_deviations(both, information, contour.parts, shared_px)
    return _Edges(both[:, 0], both[:, 1:])


def in_deviations(
    values: Array, information: Array, parts: NDArray[np.intp], shared_px: float
) -> Array:
    """Values (N, K) px, a row for each sample, in such standard deviations that errors of the
    samples, which have the covariance C, become independent.

    On each part, C = diag(1 / information) + shared_px^2. With u (N,), the roots of the
    information, the result is (I - k u u^T) diag(u) values, where
    k |u|^2 = 1 - (1 + shared_px^2 |u|^2)^-1/2.
    """
    roots = np.sqrt(information)
    scaled = roots[:, None] * values
    for part in np.unique(parts[information > 0]):
        of_part = parts == part
        u = roots[of_part]
        k = (1 - 1 / np.sqrt(1 + shared_px**2 * (u @ u))) / (u @ u)
        scaled[of_part] -= k * np.outer(u, u @ scaled[of_part])
    return np.asarray(scaled)
