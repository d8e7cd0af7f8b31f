"""Fits of an image's detections, and of shafts that its mask alone shows, to mask and edges."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.core.geometry import Camera, axis_direction, projected_axes
from shaftpose.core.instruments import Detections
from shaftpose.refinement.contour import Array, Contour, Shaft, shaft_contour
from shaftpose.refinement.contour_sampling import scaled
from shaftpose.refinement.crossings import leaving_out, met_outlines
from shaftpose.refinement.edges import Offsets, mask_offsets
from shaftpose.refinement.fit import EdgeErrors, Fit, Search, Stage, fit_pose
from shaftpose.refinement.initial_poses import (
    Start,
    first_on,
    lying_on,
    starts_at,
    starts_on,
)
from shaftpose.refinement.outlines import Outline, visible_outline
from shaftpose.refinement.straight_runs import Run, straight_runs
from shaftpose.refinement.support import distinct, supported

_MASK_STAGES = (Stage(12, 40), Stage(10, 90), Stage(7, 200), Stage(4), Stage(2))
# In pixels of each image. More stages are slower, and help only on clean images.
_EDGE_STAGES = (Stage(6), Stage(6), Stage(4), Stage(3))
# Measured (docs/beyond.md): along a line, a predicted mask is too wide or too narrow as a whole.
_MASK_ERRORS = EdgeErrors(shared_px=0.3, understated=2.0)
_STARTS = 4  # initial pitches of the fit to the mask
_RESIDUAL_PX = 4.0  # cap of a residual where the fits from several starts are compared
# Pitches may be so far below the training's range: in real frames, whose cameras may see a wider
# angle than assumed, shafts often widen more towards their near end (docs/beyond.md).
_BEYOND_DEG = 45.0
_NEAR_RUN = 0.5  # widths: a pose so near to a run may lie on it
_READER_UNDERSTATED = 14.0  # see `EdgeErrors`; at the model's resolution
# Standard deviations of the parameters (see `refinement.fit`) of a network's poses.
_NETWORK_PRIOR = np.array([5.0, 5.0, 0.07, 12.0, 10.0])

# Measured on renders with and without occluders (docs/beyond.md); px of the model's image.
_LEAST_ARC = 0.2  # information per px of a seen tip's arc, from the mask
_LEAST_READ_ARC = 40.0  # the same, from the edge reader
_AT_BORDER_PX = 1.0  # a tip nearer to the border is outside
_HIDDEN_PX = 70.0  # standard deviation, along the axis, of a tip that is not seen
# Chosen on frames (docs/beyond.md).
_EXPLAINS = 0.3  # least score of a detection that explains the run of the mask on which it lies
_MASK_ALONE = 0.2  # score of a shaft that only the mask shows
_OFF_RUNS = 0.8  # factor of the scores of detections that lie on no run

# Whether the image shows a tip, something hides it, or it lies outside of the image.
TipState = Literal["seen", "hidden", "outside"]

# Finds edges in an image (H, W, 3) in [-1, 1] within some px of a contour.
FindEdges = Callable[[NDArray[np.float32], Contour, float], Offsets]


@dataclass(frozen=True)
class FittedDetections(Detections):
    """Detections with standard deviations (K, 5) of their poses, mm and deg; NaN where the fit
    failed and the pose is the network's. tips: (K,), a `TipState` each."""

    deviations: NDArray[np.float64]
    tips: NDArray[np.str_]


class _Evidence(NamedTuple):
    """The inputs of an image's fits: the mask (H, W), the image in [-1, 1] and the same in more
    pixels, and the camera that sees the mask."""

    mask: NDArray[np.float32]
    pictures: Sequence[NDArray[np.float32]]
    camera: Camera


class Refiner:
    """Fits poses of one kind of shaft to the mask and, if `edges` is given, to the edges of the
    image.

    pitches_deg: the range of the training images' poses, None if it is unknown. Fitted pitches are
    at most its upper bound, and at least `_BEYOND_DEG` below its lower one.
    """

    def __init__(
        self,
        shaft: Shaft,
        edges: FindEdges | None,
        pitches_deg: tuple[float, float] | None = None,
    ) -> None:
        self.shaft, self.edges = shaft, edges
        self._least_arc = _LEAST_ARC if edges is None else _LEAST_READ_ARC
        if not shaft.flat_tip:  # its contour has no arc
            self._least_arc = 0.0
        low, high = pitches_deg or (0.0, 180.0)
        self._pitches_deg = max(low - _BEYOND_DEG, 0.0), high
        places = (np.arange(_STARTS) + 0.5) / _STARTS
        self._starts_deg = None if pitches_deg is None else list(low + (high - low) * places)

    def __call__(
        self,
        rgb: NDArray[np.uint8],
        mask: NDArray[np.float32],
        found: Detections,
        camera: Camera,
        fine: NDArray[np.uint8] | None = None,
    ) -> FittedDetections:
        """Fit all detections, and the shafts that the mask shows and no detection explains
        (`straight_runs`). Of poses that show the same shaft, only the best is kept.

        rgb: (H, W, 3). mask: (h, w), the probability of a shaft, with the same field of view.
        camera: the pinhole that sees both. fine: (k H, k W, 3), the same view in more pixels, whose
        edges are more exact. Boxes become the extents of the contours; scores take the mask's
        support into account. A detection keeps its pose and box if the fits find too few edges or
        lead out of sight. It also keeps its box if the tip is not flat, because its contour then
        has only lines.
        """
        wide = np.asarray(cv2.resize(mask, rgb.shape[1::-1]), dtype=np.float32)
        pictures = [scaled(image) for image in (rgb, fine) if image is not None]
        evidence = _Evidence(wide, pictures, camera)
        runs = straight_runs(wide, camera) if self.shaft.flat_tip else []
        fitted = self._fitted(found, self._starts(found.poses, runs, camera), evidence)
        if self.shaft.flat_tip:
            fitted = self._with_runs(fitted, runs, evidence)
        order = np.argsort(-fitted.scores, kind="stable")
        order = order[distinct(fitted.poses[order], self.shaft, camera)]
        kept = fitted.rows(order[first_on(runs, fitted.poses[order], camera)])
        return self._apart(kept, evidence)

    def _starts(self, poses: Array, runs: Sequence[Run], camera: Camera) -> list[list[Start]]:
        """Starts of the fits of poses (K, 5): near them, and with their tips on the runs on which
        they may lie."""
        starts = [starts_at(pose, self._starts_deg) for pose in poses]
        tips = projected_axes(poses, camera)[:, 0]
        for number, row in np.argwhere(lying_on(poses, runs, camera, _NEAR_RUN)):
            run = runs[number].from_tip_near(tips[row])
            starts[row] += starts_on(run, self._starts_deg, self.shaft, camera)
        return starts

    def _with_runs(
        self, fitted: FittedDetections, runs: Sequence[Run], evidence: _Evidence
    ) -> FittedDetections:
        """The detections, less sure if they lie on no run of the mask, and the shafts on runs that
        none of them explains."""
        on = lying_on(fitted.poses, runs, evidence.camera)
        fitted = replace(fitted, scores=fitted.scores * np.where(on.any(axis=0), 1.0, _OFF_RUNS))
        explained = on[:, fitted.scores >= _EXPLAINS].any(axis=1)
        others = [run for run, known in zip(runs, explained, strict=True) if not known]
        return _joined(fitted, self._on_runs(others, evidence))

    def _on_runs(self, runs: Sequence[Run], evidence: _Evidence) -> FittedDetections:
        """Shafts that the mask alone shows, by its runs."""
        starts = [starts_on(run, self._starts_deg, self.shaft, evidence.camera) for run in runs]
        poses = np.array([each[0].pose for each in starts]).reshape(-1, 5)
        shown = Detections(poses[:, :4], np.full(len(poses), _MASK_ALONE), poses)
        return self._fitted(shown, starts, evidence)

    def _fitted(
        self, found: Detections, starts: Sequence[Sequence[Start]], evidence: _Evidence
    ) -> FittedDetections:
        """All detections, with poses fitted from their starts where there are enough edges, and
        with new scores."""
        camera = evidence.camera
        tips = np.array([tip_state(pose, camera) for pose in found.poses], dtype="<U7")
        boxes, poses = found.boxes.copy(), found.poses.copy()
        fitted = FittedDetections(boxes, found.scores, poses, np.full_like(poses, np.nan), tips)
        for row, each in enumerate(starts):
            self._fit_row(fitted, row, each, evidence, ())
        rows = zip(found.scores, fitted.poses, strict=True)
        scores = [supported(*row, evidence.mask, self.shaft, camera) for row in rows]
        return replace(fitted, scores=np.array(scores))

    def _apart(self, fitted: FittedDetections, evidence: _Evidence) -> FittedDetections:
        """The same shafts; those that meet others are fitted again, without the edges on these."""
        met = met_outlines(fitted.poses, self.shaft, evidence.camera)
        for row, outlines in enumerate(met):
            if outlines and np.isfinite(fitted.deviations[row]).all():
                starts = starts_at(fitted.poses[row], self._starts_deg)
                self._fit_row(fitted, row, starts, evidence, outlines)
        return fitted

    def _fit_row(
        self,
        fitted: FittedDetections,
        row: int,
        starts: Sequence[Start],
        evidence: _Evidence,
        others: Sequence[Outline],
    ) -> None:
        """Replace a row by the last of the fits that is in sight, if there is one."""
        camera, fits = evidence.camera, self._fits(starts, evidence, others)
        for fit in reversed(fits):
            contour = shaft_contour(fit.pose, self.shaft, camera)
            if not len(contour.points):  # the last step has led out of sight
                continue
            fitted.poses[row] = fit.pose
            # In more pixels than the model's, each px of the same arc tells less.
            arc_information = fits[:2][-1].arc_information
            fitted.tips[row] = tip_state(fit.pose, camera, arc_information, self._least_arc)
            fitted.deviations[row] = _deviations(fit, fitted.tips[row], camera)
            outline = visible_outline(fit.pose, self.shaft, camera)
            if self.shaft.flat_tip and len(outline):
                fitted.boxes[row] = [*outline.min(axis=0), *outline.max(axis=0)]
            return

    def _fits(
        self, starts: Sequence[Start], evidence: _Evidence, others: Sequence[Outline]
    ) -> list[Fit]:
        """The fit to the mask, followed by a fit to the edges of each picture in turn; failed ones
        are left out. Empty if the fit to the mask fails."""
        search = leaving_out(others, partial(mask_offsets, evidence.mask))
        on_mask = self._on_mask(starts, search, evidence.camera)
        if on_mask is None:
            return []
        fits = [on_mask]
        for picture in evidence.pictures if self.edges is not None else ():
            fit = self._on_edges(picture, fits[-1], on_mask, evidence.camera, others)
            if fit is not None:
                fits.append(fit)
        return fits

    def _on_edges(
        self,
        picture: NDArray[np.float32],
        start: Fit,
        prior: Fit,
        camera: Camera,
        others: Sequence[Outline],
    ) -> Fit | None:
        """The fit to the edges of a picture; the fit to the mask is the prior."""
        assert self.edges is not None
        times = picture.shape[1] // camera.width
        search = leaving_out(others, partial(self.edges, picture), times)
        enlarged = camera.enlarged(times)
        # An outline has the same number of samples in more pixels; each counts for `times` as many.
        errors = EdgeErrors(understated=_READER_UNDERSTATED * times**0.5)
        return fit_pose(
            start.pose, self.shaft, enlarged, search, _EDGE_STAGES, errors,
            prior.information_in(enlarged), prior.pose, self._pitches_deg,
        )  # fmt: skip

    def _on_mask(self, starts: Sequence[Start], search: Search, camera: Camera) -> Fit | None:
        """The best of the fits to the mask from several poses."""
        prior = np.diag(_NETWORK_PRIOR**-2)
        fits = [
            fit_pose(
                pose, self.shaft, camera, search, _MASK_STAGES, _MASK_ERRORS, prior, prior_pose,
                self._pitches_deg,
            )
            for pose, prior_pose in starts
        ]  # fmt: skip
        residuals = [
            np.inf if fit is None else self._residual(fit.pose, search, camera) for fit in fits
        ]
        return fits[int(np.argmin(residuals))]

    def _residual(self, pose: Array, search: Search, camera: Camera) -> float:
        """The mean squared offset of a mask's edges along the contour of a pose, px^2; where there
        is no edge, it counts as `_RESIDUAL_PX`."""
        contour = shaft_contour(pose, self.shaft, camera)
        if not len(contour.points):
            return np.inf
        offsets = search(contour, _RESIDUAL_PX)
        within = np.minimum(np.abs(offsets.px), _RESIDUAL_PX)
        squares = offsets.weights * within**2 + (1 - offsets.weights) * _RESIDUAL_PX**2
        return float(np.average(squares, weights=contour.lengths))


def tip_state(
    pose: Array, camera: Camera, arc_information: float = np.inf, least: float = 0.0
) -> TipState:
    """`outside` if the tip of a pose (5,) lies outside the image or at its border, else `seen` if
    its arc has enough information, else `hidden`.

    arc_information: see `Fit`; least: of a seen tip.
    """
    if pose[2] <= 0 or not camera.border_px(camera.project(pose[:3])) > _AT_BORDER_PX:
        return "outside"
    return "seen" if arc_information >= least else "hidden"


def _deviations(fit: Fit, tip: str, camera: Camera) -> Array:
    """The standard deviations (5,) of a fitted pose, mm and deg. A tip that the image does not show
    may lie elsewhere on the axis."""
    covariance = fit.covariance()
    if tip != "seen":
        along_mm = _HIDDEN_PX * fit.pose[2] / camera.focal_px * axis_direction(*fit.pose[3:])
        covariance[:3, :3] += np.outer(along_mm, along_mm)
    return np.sqrt(np.diag(covariance))


def _joined(detections: FittedDetections, more: FittedDetections) -> FittedDetections:
    """The detections, and those of `more` whose poses were fitted."""
    new = more.rows(np.isfinite(more.deviations).all(axis=1))
    parts = zip(vars(detections).values(), vars(new).values(), strict=True)
    return FittedDetections(*(np.concatenate(both) for both in parts))
