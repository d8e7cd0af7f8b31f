"""Edges of a mask along the normals of a contour."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shaftpose.refinement.contour import Array, Contour
from shaftpose.refinement.contour_sampling import profiles, symmetric_steps

_STEP_PX = 0.5  # between the samples of a profile


class Offsets(NamedTuple):
    """Distances (N,) px of edges from a contour, positive outwards, and their weights (N,).

    weights: information per pixel of outline; 1 for a clear edge of a mask.
    """

    px: Array
    weights: Array


def mask_offsets(mask: NDArray[np.float32], contour: Contour, reach_px: float) -> Offsets:
    """Find the edges of a soft mask (H, W) in [0, 1] within `reach_px` of the contour.

    No threshold is needed: the integral of a profile that steps from 1 to 0 is the position of the
    step.
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
    """Contrast (N,) in [0, 1] of a soft mask (H, W) across a contour, between `reach_px` inside and
    `reach_px` outside, and lengths (N,) px of the contour's samples, 0 where these places lie
    outside the mask."""
    ends, inside = profiles(mask, contour, np.array([-reach_px, reach_px]))
    return np.clip(ends[:, 0] - ends[:, 1], 0.0, 1.0).astype(float), contour.lengths * inside
