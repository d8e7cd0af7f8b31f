"""Refinement of all detections of an image by a fit to its mask and its edges."""

from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.core.geometry import Camera
from shaftpose.core.instruments import Detections
from shaftpose.core.refinement import Refinement
from shaftpose.deployment.refinement.contour import Array, Shaft, shaft_contour
from shaftpose.deployment.refinement.edges import image_gradients, image_offsets, mask_offsets
from shaftpose.deployment.refinement.fit import Fit, Stage, fit_pose
from shaftpose.deployment.refinement.fitted_detections import FittedDetections

# More stages are no more accurate (docs/beyond.md).
_MASK_STAGES = (Stage(12, 40), Stage(10, 90), Stage(7, 200), Stage(4), Stage(2))
_EDGE_STAGES = (Stage(0.8), Stage(0.8), Stage(0.6))
# Standard deviations of the parameters of a network's poses: see
# `shaftpose.deployment.refinement.fit`.
_NETWORK_PRIOR = np.array([5.0, 5.0, 0.2, 12.0, 10.0])


class Refiner:
    """Fits the poses of one kind of shaft, seen by a pinhole camera."""

    def __init__(self, shaft: Shaft, camera: Camera, refinement: Refinement) -> None:
        self.shaft, self.camera, self.edges = shaft, camera, refinement == "edges"

    def __call__(
        self, rgb: NDArray[np.uint8], mask: NDArray[np.float32], found: Detections
    ) -> FittedDetections:
        """Detections with fitted poses and the extents of their contours in the image as boxes.

        rgb: (H, W, 3); mask: (h, w), the probability of a shaft, of the same field of view. A
        detection keeps its pose if the fit finds too few edges, and its box also if the tip is not
        flat: the contour has only lines then.
        """
        wide = np.asarray(cv2.resize(mask, rgb.shape[1::-1]), dtype=np.float32)
        gradients = image_gradients(rgb) if self.edges else None
        poses, boxes = found.poses.copy(), found.boxes.copy()
        deviations = np.full_like(poses, np.nan)
        for row, start in enumerate(found.poses):
            if (fit := self._fit(start, wide, gradients)) is None:
                continue
            poses[row] = fit.pose
            deviations[row] = np.sqrt(np.diag(fit.covariance(self.camera)))
            points = shaft_contour(fit.pose, self.shaft, self.camera).points
            if self.shaft.flat_tip and len(points):
                boxes[row] = [*points.min(axis=0), *points.max(axis=0)]
        return FittedDetections(boxes, found.scores, poses, deviations)

    def _fit(
        self, start: Array, mask: NDArray[np.float32], gradients: NDArray[np.float32] | None
    ) -> Fit | None:
        in_mask = partial(mask_offsets, mask)
        held = np.diag(_NETWORK_PRIOR**-2)
        fit = fit_pose(start, self.shaft, self.camera, in_mask, _MASK_STAGES, held)
        if fit is None or gradients is None:
            return fit
        in_image = partial(image_offsets, gradients)
        # The mask was learned from the same edges, so the two are not independent: `fit_pose`
        # divides the mask's information a second time.
        polished = fit_pose(
            fit.pose, self.shaft, self.camera, in_image, _EDGE_STAGES, fit.information
        )
        return polished or fit
