"""Where the edges of a mask lie along the normals of a contour."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shaftpose.refinement.contour import Array, Contour
from shaftpose.refinement.contour_sampling import profiles, symmetric_steps

_STEP_PX = 0.5  # between the samples of a profile


class Offsets(NamedTuple):
    """px: (N,) distance of the edge from the contour, positive outwards; weights: (N,), how much
    each tells: the information from 1 px of outline, where 1 is that of a mask's clear edge."""

    px: Array
    weights: Array


def mask_offsets(mask: NDArray[np.float32], contour: Contour, reach_px: float) -> Offsets:
    """Edges of a soft mask (H, W) in [0, 1], within `reach_px` of the contour.

    The integral over the profile of a step from 1 to 0 is where the step lies, without a threshold.
    """
    steps = symmetric_steps(reach_px, _STEP_PX)
    read, inside = profiles(mask, contour, steps)
    ends = (read[:, 0] + read[:, -1]) / 2
    offsets = _STEP_PX * (read.sum(axis=1) - ends) + steps[0]  # by the trapezoid rule
    contrast = np.clip(read[:, 0] - read[:, -1], 0.0, 1.0) * inside
    robust = 1 / (1 + (offsets / (0.3 * reach_px)) ** 2)
    return Offsets(offsets, contrast**2 * robust)


def mask_contrast(
    mask: NDArray[np.float32], contour: Contour, reach_px: float
) -> tuple[Array, Array]:
    """How much a soft mask (H, W) falls from `reach_px` inside of a contour to as far outside, (N,)
    in [0, 1], and the lengths (N,) px of the contour for which that lies in the mask, else 0."""
    ends, inside = profiles(mask, contour, np.array([-reach_px, reach_px]))
    return np.clip(ends[:, 0] - ends[:, 1], 0.0, 1.0).astype(float), contour.lengths * inside
