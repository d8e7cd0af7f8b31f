"""Straight runs of a mask whose width changes linearly, as the images of shafts are.

A region of a mask may hold several runs, which cross or touch, and a run may consist of several
regions, with an occluder or a highlight between them.
"""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.core.geometry import Array, Camera
from shaftpose.refinement.ridges import Lines, ridge_lines
from shaftpose.refinement.slices import slice_contrasts, visible

_MOST = 8  # runs of a mask
_SLICES = np.linspace(0, 1, 120)  # of a line, from border to border
# A run gains by slices of a higher contrast and loses by others. So it can bridge a gap up to about
# four times as long as what follows; `_LONGEST_GAP` limits this afterwards.
_BREAK_EVEN = 0.2
_LEAST_HALF_PX = 1.0
_LEAST_GAIN = 10.0
_CLEAR, _LEAST_KNOWN = 0.5, 0.3  # least share of the run's contrast, and weight, of a clear slice
_LONGEST_GAP = 3.0  # widths: two shafts that point at each other are no run
_MARGIN_PX = 4.0  # around a run: pixels that belong to it, too
_LEAST_LENGTH, _LEAST_PX = 0.6, 300.0  # length in widths, and area
_AT_BORDER, _AT_BORDER_PX = 0.5, 4.0  # widths: an end so near to the border is on it


class Run(NamedTuple):
    """A straight run of a mask: its ends (2, 2) px and the widths (2,) px there.

    The first end is the tip. outside: whether the tip lies beyond the border, on which both ends
    are.
    """

    ends: Array
    widths: Array
    outside: bool = False

    @property
    def length(self) -> float:
        """The distance of its ends, px."""
        return float(np.linalg.norm(self.ends[1] - self.ends[0]))

    @property
    def direction(self) -> Array:
        """The unit vector (2,) from the first end to the second."""
        return np.asarray((self.ends[1] - self.ends[0]) / self.length)

    def from_tip_near(self, tip: Array) -> "Run":
        """The same run from the place nearest to another tip (2,) px, if it is before its end."""
        along = float((tip - self.ends[0]) @ self.direction)
        if along > self.length - 1:
            return self
        change = (self.widths[1] - self.widths[0]) / self.length
        width = max(self.widths[0] + along * change, 1.0)
        first = self.ends[0] + along * self.direction
        return Run(np.stack([first, self.ends[1]]), np.array([width, self.widths[1]]))


def straight_runs(mask: NDArray[np.float32], camera: Camera) -> list[Run]:
    """The straight runs of a mask (H, W) in [0, 1] that a camera sees.

    They are found one after another. The pixels of a run that was found become unknown, so that the
    next may cross it.
    """
    rng, field, runs = np.random.default_rng(0), visible(mask, camera), list[Run]()
    known = field.copy()
    while len(runs) < _MOST:
        lines = ridge_lines((mask > 0.5) & known, field, rng)
        run = _best_run(mask, known, lines, camera) if len(lines.halves) else None
        if run is None:
            break
        runs.append(run)
        _leave_out(known, run)
    return [_from_tip(run, camera) for run in runs if _is_shaft(run)]


def _best_run(
    mask: NDArray[np.float32], known: NDArray[np.bool_], lines: Lines, camera: Camera
) -> Run | None:
    """The run that gains most of all parts of lines; None if none gains enough."""
    low, high = camera.span(lines.points, lines.directions)
    along = low + (high - low) * _SLICES
    halves = lines.halves_at(along)
    contrasts, weights = slice_contrasts(mask, known, lines, along)
    weights = weights * (halves > _LEAST_HALF_PX)
    slice_px = (high - low) / len(_SLICES)
    gains = weights * (contrasts - _BREAK_EVEN) * np.sqrt(np.maximum(halves, 0.0)) * slice_px
    line, first, last = _best_part(gains)
    part = np.arange(first, last + 1)
    if gains[line, part].sum() < _LEAST_GAIN:
        return None
    seen = part[weights[line, part] > _LEAST_KNOWN]
    mean = np.average(contrasts[line, part], weights=weights[line, part])
    clear = contrasts[line, seen] > _CLEAR * mean
    gap = _LONGEST_GAP * 2 * halves[line, part].mean() / slice_px[line, 0]
    shown = max(_pieces(seen, clear, gap), key=lambda piece: float(gains[line, piece].sum()))
    if len(shown) < 2:
        return None
    ends = lines.points[line] + np.outer(along[line, shown[[0, -1]]], lines.directions[line])
    return Run(ends, 2 * halves[line, shown[[0, -1]]])


def _pieces(
    slices: NDArray[np.intp], clear: NDArray[np.bool_], gap: float
) -> list[NDArray[np.intp]]:
    """The clear ones of slices (N,), split where more than `gap` others lie between them."""
    others = np.diff(np.cumsum(~clear)[clear])
    return np.split(slices[clear], np.flatnonzero(others > gap) + 1)


def _best_part(gains: Array) -> tuple[int, int, int]:
    """Row, first and last column of the consecutive gains (L, S) of a row with the largest sum."""
    sums = np.cumsum(gains, axis=1)
    before = sums - gains
    rises = sums - np.minimum.accumulate(before, axis=1)
    row, last = np.unravel_index(int(np.argmax(rises)), rises.shape)
    return int(row), int(np.argmin(before[row, : last + 1])), int(last)


def _leave_out(known: NDArray[np.bool_], run: Run) -> None:
    """Set the pixels of a run and of a margin around it to false."""
    across = np.array([-run.direction[1], run.direction[0]])
    first, last = run.ends + np.outer([-_MARGIN_PX, _MARGIN_PX], run.direction)
    aside, beside = np.outer(run.widths / 2 + _MARGIN_PX, across)
    corners = np.array([first + aside, last + beside, last - beside, first - aside])
    part = np.zeros(known.shape, np.uint8)
    cv2.fillConvexPoly(part, corners.round().astype(np.int32), (1,))
    known &= part == 0


def _is_shaft(run: Run) -> bool:
    long = run.length >= _LEAST_LENGTH * run.widths.max()
    return bool(long and run.length * run.widths.mean() >= _LEAST_PX)


def _from_tip(run: Run, camera: Camera) -> Run:
    """The run from its tip: of two ends on the border, the narrower one, else the one that is
    farther from the border along the run."""
    low, high = (float(end[0, 0]) for end in camera.span(run.ends[:1], run.direction[None]))
    border = np.array([-low, high - run.length])
    outside = bool((border < np.maximum(_AT_BORDER * run.widths, _AT_BORDER_PX)).all())
    tip = int(np.argmin(run.widths) if outside else np.argmax(border))
    return Run(run.ends[[tip, 1 - tip]], run.widths[[tip, 1 - tip]], outside)
