"""Pose errors binned by depth, pitch, yaw, visible fraction and distance from the border."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.geometry import signed_deg
from shaftpose.core.instruments import POSE_DIMENSIONS
from shaftpose.metrics.detection.matching import Array
from shaftpose.metrics.pose_errors import PoseErrors

# Number of equal bins in the range of a quantity, or bin edges. Yaw is measured from the seam, the
# lower end of its range (358 deg meets 0), where a regressed angle jumps.
BINS: Mapping[str, int | Sequence[float]] = {
    "z_mm": 6,
    "pitch_deg": 5,
    "yaw_from_seam_deg": (-180, -120, -60, -30, -10, 0, 10, 30, 60, 120, 180),
    "visible_fraction": (0, 0.5, 0.75, 0.9, 0.99, 1),
    "border_px": (0, 10, 20, 40, 80, 150),
}
BIAS = "z_bias_mm"
ERRORS = ("tip_mm", "axis_deg", BIAS)
_Z = POSE_DIMENSIONS.index("z_mm")


@dataclass(frozen=True)
class ErrorBin:
    """Number and median errors of the detected instruments in one bin; None if the bin is empty.

    tip_mm, axis_deg: absolute; z_bias_mm: estimated minus true depth, None in results of older
    versions.
    """

    low: float
    high: float
    count: int
    tip_mm: float | None
    axis_deg: float | None
    z_bias_mm: float | None = None


def binned_errors(
    errors: PoseErrors,
    visible_fractions: Array,
    border_px: Array,
    low: Sequence[float],
    high: Sequence[float],
) -> dict[str, list[ErrorBin]]:
    """The bins of each quantity of `BINS`; the outer bins include values beyond their edges.

    visible_fractions: (G,) of all instruments of the set, indexed by `errors.instruments`;
    border_px: (M,) distances of the true tips from the image's border; low, high: (5,) limits of
    the poses.
    """
    ranges = dict(zip(POSE_DIMENSIONS, zip(low, high, strict=True), strict=True))
    true = dict(zip(POSE_DIMENSIONS, errors.true_poses.T, strict=True))
    values = {
        "z_mm": true["z_mm"],
        "pitch_deg": true["pitch_deg"],
        "yaw_from_seam_deg": signed_deg(true["yaw_deg"] - ranges["yaw_deg"][0]),
        "visible_fraction": visible_fractions[errors.instruments],
        "border_px": border_px,
    }
    return {name: _bins(errors, values[name], _edges(name, ranges)) for name in BINS}


def _edges(name: str, ranges: Mapping[str, tuple[float, float]]) -> list[float]:
    bins = BINS[name]
    if isinstance(bins, int):
        low, high = ranges[name]
        return [float(edge) for edge in np.linspace(low, high, bins + 1)]
    return list(bins)


def _bins(errors: PoseErrors, values: Array, edges: Sequence[float]) -> list[ErrorBin]:
    bins = np.digitize(values, edges[1:-1])
    return [
        ErrorBin(low, high, int(np.sum(bins == n)), **_medians(errors, bins == n))
        for n, (low, high) in enumerate(zip(edges[:-1], edges[1:], strict=True))
    ]


def _medians(errors: PoseErrors, chosen: NDArray[np.bool_]) -> dict[str, float | None]:
    values = (errors.tip_mm, errors.axis_deg, errors.differences[:, _Z])
    return {
        name: float(np.median(each[chosen])) if chosen.any() else None
        for name, each in zip(ERRORS, values, strict=True)
    }
