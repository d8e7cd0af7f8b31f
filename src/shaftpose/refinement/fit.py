"""Fit of one pose to the edges of a mask or of an image.

A pose is fitted in the parameters of `pose_parameters`, because a network errs along the ray
through the tip far more than across it.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.geometry import Camera, signed_deg
from shaftpose.refinement.contour import ARC, Array, Contour, Shaft, shaft_contour
from shaftpose.refinement.edges import Offsets
from shaftpose.refinement.pose_parameters import derivatives, moved, parameters

_LARGEST_STEP = np.array([12.0, 12.0, 0.2, 10.0, 10.0])  # of the parameters
_LEAST_INFORMATION = 10.0  # of a stage's edges; 10 px of a mask's clear outline

Search = Callable[[Contour, float], Offsets]


class EdgeErrors(NamedTuple):
    """Errors of edges in addition to the independent ones, which their weights state.

    shared_px: standard deviation of an offset that all edges on one part of the contour (a line,
    the arc) have in common. understated: ratio of the actual errors of fitted poses to the errors
    that follow from the weights and `shared_px`.
    """

    shared_px: float = 0.0
    understated: float = 1.0


class Stage(NamedTuple):
    """One iteration, which uses the edges within `reach_px` of the contour and `length_px` of the
    tip.

    Near the tip, a wrong axis displaces the contour less.
    """

    reach_px: float
    length_px: float = np.inf


class Fit(NamedTuple):
    """A fitted pose (5,) mm, deg, and the Fisher information (5, 5) about its parameters, the first
    two in pixels of `camera`.

    arc_information: from the edges along the tip's arc, per px of arc; 0 if none is in the image.
    """

    pose: Array
    information: Array
    camera: Camera
    arc_information: float

    def covariance(self) -> Array:
        """The covariance (5, 5) of the pose."""
        spread = derivatives(self.pose, self.camera)
        return np.asarray(spread @ np.linalg.inv(self.information) @ spread.T)

    def information_in(self, camera: Camera) -> Array:
        """The information about the parameters for a camera with the same view and other pixels."""
        scale = np.diag([self.camera.focal_px / camera.focal_px] * 2 + [1.0] * 3)
        return np.asarray(scale @ self.information @ scale)


class _Edges(NamedTuple):
    """Whitened equations of the edges along a contour, whose errors are independent and have a
    standard deviation of 1: their offsets (N,), and the derivatives of the contour's motion along
    its normals by the parameters (N, 5). arc_information: see `Fit`."""

    offsets: Array
    motion: Array
    arc_information: float


def fit_pose(
    start: Array,
    shaft: Shaft,
    camera: Camera,
    search: Search,
    stages: Sequence[Stage],
    errors: EdgeErrors,
    prior_information: Array,
    prior_pose: Array | None = None,
    pitches_deg: tuple[float, float] = (0.0, 180.0),
) -> Fit | None:
    """Fit a pose (5,) to the edges that `search` finds, one Gauss-Newton step in each stage; None
    if the last stage finds too few edges.

    The step minimizes the offsets of the edges along the contour's normals, weighted by their
    information and by `errors`. prior_information: (5, 5), about the parameters of `prior_pose`, by
    default the start; it determines what the edges leave open. pitches_deg: the range in which the
    pitch is kept.
    """
    if not np.isfinite(start).all() or start[2] <= 0:
        return None
    pose, edge_information, edges = start, np.zeros_like(prior_information), None
    prior_pose = start if prior_pose is None else prior_pose
    for stage in stages:
        edges = _edges(pose, shaft, camera, search, stage, errors.shared_px)
        if edges is None:  # perhaps behind an occluder: further from the tip there may be more
            continue
        edge_information = edges.motion.T @ edges.motion
        to_prior = parameters(prior_pose, camera) - parameters(pose, camera)
        to_prior[4] = signed_deg(to_prior[4])
        step = np.linalg.solve(
            edge_information + prior_information,
            edges.motion.T @ edges.offsets + prior_information @ to_prior,
        )
        pose = moved(pose, np.clip(step, -_LARGEST_STEP, _LARGEST_STEP), camera)
        pose[3] = np.clip(pose[3], *pitches_deg)
    if edges is None:
        return None
    information = edge_information / errors.understated**2 + prior_information
    return Fit(pose, information, camera, edges.arc_information)


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
    if information.sum() < _LEAST_INFORMATION:
        return None
    motion = contour.motion @ derivatives(pose, camera)
    both = np.column_stack([offsets.px, motion])
    both = whitened(both, information, contour.parts, shared_px)
    on_arc = contour.parts == ARC
    arc_px = float(contour.lengths[on_arc].sum())
    arc_information = float(information[on_arc].sum()) / arc_px if arc_px else 0.0
    return _Edges(both[:, 0], both[:, 1:], arc_information)


def whitened(values: Array, information: Array, parts: NDArray[np.intp], shared_px: float) -> Array:
    """Whiten values (N, K) px, a row for each sample: multiply them by a root of the inverse of
    the covariance C of the samples' errors.

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
