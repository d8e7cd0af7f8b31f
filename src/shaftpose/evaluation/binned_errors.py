"""Where pose errors are large: by depth, pitch, yaw and how much of a shaft is visible."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from shaftpose.config import PoseRanges
from shaftpose.evaluation.boxes import Array
from shaftpose.evaluation.pose_errors import PoseErrors
from shaftpose.instruments import POSE_DIMENSIONS

# Into how many bins of one width the range of a quantity is divided, or the edges of its bins. Yaw
# is counted from the seam, the lower end of its range (358 deg meets 0), where an angle that is
# learned as a number jumps.
BINS: Mapping[str, int | Sequence[float]] = {
    "z_mm": 6,
    "pitch_deg": 5,
    "yaw_from_seam_deg": (-180, -120, -60, -30, -10, 0, 10, 30, 60, 120, 180),
    "visible_fraction": (0, 0.5, 0.75, 0.9, 0.99, 1),
}
ERRORS = ("tip_mm", "axis_deg")


@dataclass(frozen=True)
class ErrorBin:
    """The instruments that were found between two values of a quantity, and the medians of their
    absolute errors; None where there is no instrument."""

    low: float
    high: float
    count: int
    tip_mm: float | None
    axis_deg: float | None


def binned_errors(
    errors: PoseErrors, visible_fractions: Array, ranges: PoseRanges
) -> dict[str, list[ErrorBin]]:
    """The bins of each quantity of `BINS`; the outer ones take what lies beyond.

    visible_fractions: of each instrument of the set (G,), numbered as `errors.instruments` is.
    ranges: that poses are drawn from.
    """
    true = dict(zip(POSE_DIMENSIONS, errors.true_poses.T, strict=True))
    values = {
        "z_mm": true["z_mm"],
        "pitch_deg": true["pitch_deg"],
        "yaw_from_seam_deg": (true["yaw_deg"] - ranges.yaw_deg[0] + 180.0) % 360.0 - 180.0,
        "visible_fraction": visible_fractions[errors.instruments],
    }
    return {name: _bins(errors, values[name], _edges(name, ranges)) for name in BINS}


def as_plain(bins: Mapping[str, Sequence[ErrorBin]]) -> dict[str, list[dict[str, float | None]]]:
    """Plain values by quantity, ready for JSON; `from_plain` is the way back."""
    return {quantity: [asdict(one) for one in row] for quantity, row in bins.items()}


def from_plain(
    content: Mapping[str, Sequence[Mapping[str, float | None]]],
) -> dict[str, list[ErrorBin]]:
    """What `as_plain` was made of."""
    return {q: [ErrorBin(**one) for one in row] for q, row in content.items()}  # type: ignore[arg-type]


def _edges(name: str, ranges: PoseRanges) -> list[float]:
    bins = BINS[name]
    if isinstance(bins, int):
        low, high = getattr(ranges, name)
        return [float(edge) for edge in np.linspace(low, high, bins + 1)]
    return list(bins)


def _bins(errors: PoseErrors, values: Array, edges: Sequence[float]) -> list[ErrorBin]:
    bins = np.digitize(values, edges[1:-1])
    return [
        ErrorBin(low, high, int(np.sum(bins == n)), **_medians(errors, bins == n))
        for n, (low, high) in enumerate(zip(edges[:-1], edges[1:], strict=True))
    ]


def _medians(errors: PoseErrors, chosen: NDArray[np.bool_]) -> dict[str, float | None]:
    return {
        name: float(np.median(getattr(errors, name)[chosen])) if chosen.any() else None
        for name in ERRORS
    }
