"""Lines along the ridges of a mask, with half widths that change linearly along them.

A ridge is where the distance from the mask's edges is largest. At a crossing it leaves the axes of
the shafts, but a line through ridge points on both sides does not.
"""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.core.geometry import Array

_PART, _GAP = np.ones((3, 3), np.uint8), np.ones((5, 5), np.uint8)  # thinner ones do not count
_FALL = 0.3  # px: no neighbour of a ridge point lies farther from the edges by more
_LEAST_HALF_PX = 2.0
_POINTS = 150  # of the ridges, used at most
_PAIRS = 300  # of points, drawn as lines (RANSAC)
_LINES = 24  # kept at most
_APART_PX = 12.0  # of the two points of a line
_STEEPEST = 0.3  # change of the half width along a line
# A ridge point supports a line if it lies on it and is as wide, up to a share of the half width.
_OFF, _OFF_PX = 0.2, 1.5
_LEAST_POINTS = 8


class Lines(NamedTuple):
    """Lines through points (L, 2) px with directions (L, 2), half widths (L,) px at the points and
    the changes (L,) of these along the directions."""

    points: Array
    directions: Array
    halves: Array
    slopes: Array

    def rows(self, chosen: NDArray[np.intp] | NDArray[np.bool_]) -> "Lines":
        """The lines with these indices, or where a mask (L,) is true."""
        return Lines(*(values[chosen] for values in self))

    @property
    def normals(self) -> Array:
        """Unit vectors (L, 2) across the lines."""
        return np.column_stack([-self.directions[:, 1], self.directions[:, 0]])

    def halves_at(self, along: Array) -> Array:
        """Half widths (L, S) px at distances (L, S) from the points."""
        return np.asarray(self.halves[:, None] + self.slopes[:, None] * along)


def ridge_lines(
    shown: NDArray[np.bool_], field: NDArray[np.bool_], rng: np.random.Generator
) -> Lines:
    """The lines with most ridge points of a mask (H, W), at most 24, each several times.

    field: (H, W), the visible field, beyond which the mask may continue.
    """
    points, halves = _ridge(shown, field)
    lines = _through_pairs(points, halves, rng)
    support = _support(lines, points, halves)
    best = np.argsort(-support * np.sqrt(lines.halves), kind="stable")[:_LINES]
    return lines.rows(best[support[best] >= _LEAST_POINTS])


def _ridge(shown: NDArray[np.bool_], field: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Points (P, 2) px on the ridges, and half widths (P,) px there."""
    smooth = cv2.morphologyEx(shown.astype(np.uint8), cv2.MORPH_OPEN, _PART)
    smooth = cv2.morphologyEx(smooth, cv2.MORPH_CLOSE, _GAP)
    inside = smooth | (~field).astype(np.uint8)
    depth = cv2.distanceTransform(inside, cv2.DIST_L2, cv2.DIST_MASK_5)
    depth = np.minimum(depth, max(shown.shape))  # infinite if the mask covers all
    highest = depth >= cv2.dilate(depth, _PART) - _FALL
    ridge = highest & (depth > _LEAST_HALF_PX) & (smooth > 0) & field
    found = cv2.findNonZero(ridge.astype(np.uint8))
    at = np.empty((0, 2), np.intp) if found is None else found[:, 0]
    # The distance is to the centre of the nearest pixel that the mask does not cover.
    return at + 0.5, depth[at[:, 1], at[:, 0]].astype(float) - 0.5


def _through_pairs(points: Array, halves: Array, rng: np.random.Generator) -> Lines:
    """Hypotheses: lines through random pairs of points (RANSAC)."""
    first, second = rng.integers(max(len(points), 1), size=(2, _PAIRS if len(points) else 0))
    offsets = points[second] - points[first]
    apart = np.maximum(np.hypot(offsets[:, 0], offsets[:, 1]), 1.0)
    slopes = (halves[second] - halves[first]) / apart
    lines = Lines(points[first], offsets / apart[:, None], halves[first], slopes)
    return lines.rows((apart >= _APART_PX) & (np.abs(slopes) <= _STEEPEST))


def _support(lines: Lines, points: Array, halves: Array) -> NDArray[np.intp]:
    """The number (L,) of each line's inliers in a sample of the points: on it, and as wide."""
    step = max(-(-len(points) // _POINTS), 1)
    points, halves = points[::step], halves[::step]
    along, aside = (
        axes @ points.T - (axes * lines.points).sum(axis=1)[:, None]
        for axes in (lines.directions, lines.normals)
    )
    wide = lines.halves_at(along)
    most = np.maximum(_OFF * wide, _OFF_PX)
    return np.count_nonzero((np.abs(aside) < most) & (np.abs(wide - halves) < most), axis=1)
