"""Refinement of all detections of an image by a fit to its mask and its edges."""

from collections.abc import Callable, Sequence
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.core.geometry import Camera
from shaftpose.core.instruments import Detections
from shaftpose.refinement.contour import Array, Contour, Shaft, shaft_contour
from shaftpose.refinement.edges import Offsets, mask_offsets
from shaftpose.refinement.fit import EdgeErrors, Fit, Stage, fit_pose
from shaftpose.refinement.fitted_detections import FittedDetections
from shaftpose.refinement.mask_starts import unexplained_starts
from shaftpose.refinement.outline_strips import scaled
from shaftpose.refinement.support import distinct, supported

_MASK_STAGES = (Stage(12, 40), Stage(10, 90), Stage(7, 200), Stage(4), Stage(2))
# In pixels of each image. More are slower, and better only on clean images (docs/beyond.md).
_EDGE_STAGES = (Stage(6), Stage(6), Stage(4), Stage(3))
# Measured (docs/beyond.md): along a line, a predicted mask is too wide or too narrow as a whole.
_MASK_ERRORS = EdgeErrors(shared_px=0.3, understated=2.0)
_READER_ERRORS = EdgeErrors(understated=12.0)
# Standard deviations of the parameters of a network's poses: see
# `shaftpose.refinement.fit`.
_NETWORK_PRIOR = np.array([5.0, 5.0, 0.07, 12.0, 10.0])

# Of a detection that explains the mask where it lies: its score at least; and the score of a tip
# that only the mask shows (docs/beyond.md).
_EXPLAINS, _MASK_ALONE = 0.3, 0.2

# Finds edges in an image (H, W, 3) in [-1, 1], near a contour, within so many px: `LearnedEdges`.
FindEdges = Callable[[NDArray[np.float32], Contour, float], Offsets]


class Refiner:
    """Fits the poses of one kind of shaft, seen by a pinhole camera, to the mask and, if `edges` is
    given, to the edges of the image."""

    def __init__(self, shaft: Shaft, camera: Camera, edges: FindEdges | None) -> None:
        self.shaft, self.camera, self.edges = shaft, camera, edges

    def __call__(
        self,
        rgb: NDArray[np.uint8],
        mask: NDArray[np.float32],
        found: Detections,
        fine: NDArray[np.uint8] | None = None,
    ) -> FittedDetections:
        """Detections with fitted poses and the extents of their contours in the image as boxes,
        scored by the mask's support as well; of those that show the same shaft, only the best. What
        the mask shows and no detection explains is fitted, too (`mask_starts`).

        rgb: (H, W, 3); mask: (h, w), the probability of a shaft, of the same field of view; fine:
        (k H, k W, 3), the same view in more pixels, whose edges are more exact. A detection keeps
        its pose if the fits find too few edges or lead out of sight, and its box also if the tip is
        not flat: the contour has only lines then.
        """
        wide = np.asarray(cv2.resize(mask, rgb.shape[1::-1]), dtype=np.float32)
        pictures = [scaled(image) for image in (rgb, fine) if image is not None]
        fitted = self._fitted(found, wide, pictures)
        if self.shaft.flat_tip:
            sure = fitted.above(_EXPLAINS).poses
            starts = unexplained_starts(wide, list(sure), self.shaft, self.camera)
            scores = np.full(len(starts), _MASK_ALONE)
            seen = self._fitted(Detections(starts[:, :4], scores, starts), wide, pictures)
            fitted = _joined(fitted, seen)
        order = np.argsort(-fitted.scores, kind="stable")
        return fitted.rows(order[distinct(fitted.poses[order], self.shaft, self.camera)])

    def _fitted(
        self,
        found: Detections,
        mask: NDArray[np.float32],
        pictures: Sequence[NDArray[np.float32]],
    ) -> FittedDetections:
        """All detections, with fitted poses where there are enough edges."""
        poses, boxes = found.poses.copy(), found.boxes.copy()
        deviations = np.full_like(poses, np.nan)
        for row, start in enumerate(found.poses):
            for fit in reversed(self._fits(start, mask, pictures)):
                points = shaft_contour(fit.pose, self.shaft, self.camera).points
                if not len(points):  # the last step has led out of sight
                    continue
                poses[row] = fit.pose
                deviations[row] = np.sqrt(np.diag(fit.covariance()))
                if self.shaft.flat_tip:
                    boxes[row] = [*points.min(axis=0), *points.max(axis=0)]
                break
        scores = np.array(
            [
                supported(score, pose, mask, self.shaft, self.camera)
                for score, pose in zip(found.scores, poses, strict=True)
            ]
        )
        return FittedDetections(boxes, scores, poses, deviations)

    def _fits(
        self, start: Array, mask: NDArray[np.float32], pictures: Sequence[NDArray[np.float32]]
    ) -> list[Fit]:
        """The fit to the mask, and from there to the edges of each picture in turn; those that fail
        are left out, all if it is the first."""
        in_mask = partial(mask_offsets, mask)
        held = np.diag(_NETWORK_PRIOR**-2)
        known = fit_pose(start, self.shaft, self.camera, in_mask, _MASK_STAGES, _MASK_ERRORS, held)
        if known is None:
            return []
        fits = [known]
        for picture in pictures if self.edges is not None else ():
            if (fit := self._on_edges(picture, fits[-1], known)) is not None:
                fits.append(fit)
        return fits

    def _on_edges(self, picture: NDArray[np.float32], start: Fit, known: Fit) -> Fit | None:
        """The fit to the edges of a picture, held by what the mask made known."""
        assert self.edges is not None
        camera = self.camera.enlarged(picture.shape[1] // self.camera.width)
        held = known.information_in(camera)
        return fit_pose(
            start.pose, self.shaft, camera, partial(self.edges, picture), _EDGE_STAGES,
            _READER_ERRORS, held, known.pose,
        )  # fmt: skip


def _joined(detections: FittedDetections, more: FittedDetections) -> FittedDetections:
    """The detections, and those of `more` whose poses were fitted."""
    new = more.rows(np.isfinite(more.deviations).all(axis=1))
    parts = zip(vars(detections).values(), vars(new).values(), strict=True)
    return FittedDetections(*(np.concatenate(both) for both in parts))
