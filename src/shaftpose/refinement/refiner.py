"""Refinement of all detections in an image by fits to its mask and its edges."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.core.geometry import Camera
from shaftpose.core.instruments import Detections
from shaftpose.refinement.contour import Array, Contour, Shaft, shaft_contour
from shaftpose.refinement.contour_sampling import scaled
from shaftpose.refinement.edges import Offsets, mask_offsets
from shaftpose.refinement.fit import EdgeErrors, Fit, Stage, fit_pose
from shaftpose.refinement.initial_poses import initial_poses_from_mask
from shaftpose.refinement.support import distinct, supported

_MASK_STAGES = (Stage(12, 40), Stage(10, 90), Stage(7, 200), Stage(4), Stage(2))
# In pixels of each image. More are slower, and better only on clean images (docs/beyond.md).
_EDGE_STAGES = (Stage(6), Stage(6), Stage(4), Stage(3))
# Measured (docs/beyond.md): along a line, a predicted mask is too wide or too narrow as a whole.
_MASK_ERRORS = EdgeErrors(shared_px=0.3, understated=2.0)
_READER_ERRORS = EdgeErrors(understated=12.0)
# Standard deviations of the parameters (see `refinement.fit`) of a network's poses.
_NETWORK_PRIOR = np.array([5.0, 5.0, 0.07, 12.0, 10.0])

# Least score of a detection that explains the mask where it lies, and the score of a shaft that
# only the mask shows (docs/beyond.md).
_EXPLAINS, _MASK_ALONE = 0.3, 0.2

# Finds edges in an image (H, W, 3) in [-1, 1] within some px of a contour.
FindEdges = Callable[[NDArray[np.float32], Contour, float], Offsets]


@dataclass(frozen=True)
class FittedDetections(Detections):
    """Detections with standard deviations (K, 5) of their poses, mm and deg; NaN where the fit
    failed and the pose is the network's."""

    deviations: NDArray[np.float64]


class Refiner:
    """Fits poses of one kind of shaft to the mask and, if `edges` is given, to the edges of the
    image."""

    def __init__(self, shaft: Shaft, edges: FindEdges | None) -> None:
        self.shaft, self.edges = shaft, edges

    def __call__(
        self,
        rgb: NDArray[np.uint8],
        mask: NDArray[np.float32],
        found: Detections,
        camera: Camera,
        fine: NDArray[np.uint8] | None = None,
    ) -> FittedDetections:
        """Fit all detections, and the shafts that the mask shows and no detection explains
        (`initial_poses`). Of poses that show the same shaft, only the best is kept.

        rgb: (H, W, 3). mask: (h, w), the probability of a shaft, with the same field of view.
        camera: the pinhole that sees both. fine: (k H, k W, 3), the same view in more pixels, whose
        edges are more exact. Boxes become the extents of the contours; scores take the mask's
        support into account. A detection keeps its pose and box if the fits find too few edges or
        lead out of sight. It also keeps its box if the tip is not flat, because its contour then
        has only lines.
        """
        wide = np.asarray(cv2.resize(mask, rgb.shape[1::-1]), dtype=np.float32)
        pictures = [scaled(image) for image in (rgb, fine) if image is not None]
        fitted = self._fitted(found, wide, pictures, camera)
        if self.shaft.flat_tip:
            explained = list(fitted.above(_EXPLAINS).poses)
            starts = initial_poses_from_mask(wide, explained, self.shaft, camera)
            scores = np.full(len(starts), _MASK_ALONE)
            shown = Detections(starts[:, :4], scores, starts)
            seen = self._fitted(shown, wide, pictures, camera)
            fitted = _joined(fitted, seen)
        order = np.argsort(-fitted.scores, kind="stable")
        return fitted.rows(order[distinct(fitted.poses[order], self.shaft, camera)])

    def _fitted(
        self,
        found: Detections,
        mask: NDArray[np.float32],
        pictures: Sequence[NDArray[np.float32]],
        camera: Camera,
    ) -> FittedDetections:
        """All detections, with fitted poses where there are enough edges, and with new scores."""
        poses, boxes = found.poses.copy(), found.boxes.copy()
        deviations = np.full_like(poses, np.nan)
        for row, start in enumerate(found.poses):
            for fit in reversed(self._fits(start, mask, pictures, camera)):
                points = shaft_contour(fit.pose, self.shaft, camera).points
                if not len(points):  # the last step has led out of sight
                    continue
                poses[row] = fit.pose
                deviations[row] = np.sqrt(np.diag(fit.covariance()))
                if self.shaft.flat_tip:
                    boxes[row] = [*points.min(axis=0), *points.max(axis=0)]
                break
        scores = np.array(
            [
                supported(score, pose, mask, self.shaft, camera)
                for score, pose in zip(found.scores, poses, strict=True)
            ]
        )
        return FittedDetections(boxes, scores, poses, deviations)

    def _fits(
        self,
        start: Array,
        mask: NDArray[np.float32],
        pictures: Sequence[NDArray[np.float32]],
        camera: Camera,
    ) -> list[Fit]:
        """The fit to the mask, followed by a fit to the edges of each picture in turn; failed ones
        are left out. Empty if the fit to the mask fails."""
        on_mask = fit_pose(
            start, self.shaft, camera, partial(mask_offsets, mask), _MASK_STAGES, _MASK_ERRORS,
            np.diag(_NETWORK_PRIOR**-2),
        )  # fmt: skip
        if on_mask is None:
            return []
        fits = [on_mask]
        for picture in pictures if self.edges is not None else ():
            if (fit := self._on_edges(picture, fits[-1], on_mask, camera)) is not None:
                fits.append(fit)
        return fits

    def _on_edges(
        self, picture: NDArray[np.float32], start: Fit, prior: Fit, camera: Camera
    ) -> Fit | None:
        """The fit to the edges of a picture; the fit to the mask is the prior."""
        assert self.edges is not None
        enlarged = camera.enlarged(picture.shape[1] // camera.width)
        return fit_pose(
            start.pose, self.shaft, enlarged, partial(self.edges, picture), _EDGE_STAGES,
            _READER_ERRORS, prior.information_in(enlarged), prior.pose,
        )  # fmt: skip


def _joined(detections: FittedDetections, more: FittedDetections) -> FittedDetections:
    """The detections, and those of `more` whose poses were fitted."""
    new = more.rows(np.isfinite(more.deviations).all(axis=1))
    parts = zip(vars(detections).values(), vars(new).values(), strict=True)
    return FittedDetections(*(np.concatenate(both) for both in parts))
