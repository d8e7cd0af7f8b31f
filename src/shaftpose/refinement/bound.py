"""How exactly an image shows a pose at best: the Cramer-Rao bound."""

import numpy as np

from shaftpose.core.geometry import Camera
from shaftpose.refinement.contour import Array, Shaft, shaft_contour

# Of a plain shaft on plain tissue, grey levels: the step at its edge and the noise of each pixel.
_CONTRAST, _NOISE = 60.0, 5.0


def pose_bound(pose: Array, shaft: Shaft, camera: Camera) -> Array:
    """Least standard deviations (5,), mm and deg, of an unbiased estimate of a pose (5,).

    A contour of length ds that moves by m px across itself changes the image by contrast m ds, so
    that the Fisher information is (contrast / noise)^2 times the integral of m m^T ds. The shaft's
    diameter and the camera are known. All are infinite if the contour leaves any dimension open.
    """
    contour = shaft_contour(pose, shaft, camera)
    weighted = contour.motion.T * contour.lengths
    information = (_CONTRAST / _NOISE) ** 2 * weighted @ contour.motion
    if np.linalg.matrix_rank(information) < len(pose):
        return np.full(len(pose), np.inf)
    return np.sqrt(np.diag(np.linalg.inv(information)))
