"""Pictures read along the normals of a contour."""

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.refinement.contour import Array, Contour


def symmetric_steps(reach_px: float, step_px: float) -> Array:
    """Places along a profile, at least from -reach_px to reach_px, of which 0 is one."""
    count = int(np.ceil(reach_px / step_px))
    return step_px * np.arange(-count, count + 1)


def profiles(
    picture: NDArray[np.float32], contour: Contour, steps: Array
) -> tuple[NDArray[np.float32], Array]:
    """A picture (H, W, ...) along the contour's normals, (N, S, ...), and 1 for each profile that
    lies inside the picture, else 0, (N,).

    steps: (S,) px from the contour, positive outwards.
    """
    at = contour.points[:, None] + steps[:, None] * contour.normals[:, None]
    height, width = picture.shape[:2]
    ends = at[:, [0, -1]]
    inside = np.all((ends >= 0) & (ends <= [width, height]), axis=(1, 2))
    x, y = np.moveaxis((at - 0.5).astype(np.float32), -1, 0)  # OpenCV's pixel centres: integers
    read = cv2.remap(picture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(read, dtype=np.float32), inside.astype(float)
