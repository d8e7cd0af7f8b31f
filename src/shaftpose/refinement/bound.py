"""The Cramer-Rao bound: the least error with which a pose can be estimated from an image."""

import numpy as np

from shaftpose.core.geometry import Camera
from shaftpose.refinement.contour import Array, Shaft, shaft_contour

# Grey levels, for a plain shaft on plain tissue: the step at its edge and the noise of each pixel.
_CONTRAST, _NOISE = 60.0, 5.0


def pose_bound(pose: Array, shaft: Shaft, camera: Camera) -> Array:
    """Least standard deviations (5,), mm and deg, of an unbiased estimate of a pose (5,).

    A contour of length ds that moves by m px along its normal changes the image by contrast m ds.
    The Fisher information is therefore (contrast / noise)^2 times the integral of m m^T ds. The
    shaft's diameter and the camera are known. All deviations are infinite if the contour does not
    determine every dimension.
    """
    contour = shaft_contour(pose, shaft, camera)
    weighted = contour.motion.T * contour.lengths
    information = (_CONTRAST / _NOISE) ** 2 * weighted @ contour.motion
    if np.linalg.matrix_rank(information) < len(pose):
        return np.full(len(pose), np.inf)
    return np.sqrt(np.diag(np.linalg.inv(information)))
