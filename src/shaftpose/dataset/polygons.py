"""Checks of polygons."""

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]


def crossing(polygon: Points) -> Points | None:
    """A point (2,) at which two sides of a polygon (x, y, x, y, ...) cross; None if none do.

    Sides that touch or coincide, as those around a hole, do not cross.
    """
    starts = polygon.reshape(-1, 2)
    ends = np.roll(starts, -1, axis=0)
    for n, side in enumerate(zip(starts, ends, strict=True)):
        others = starts[n + 1 :], ends[n + 1 :]
        before, after = _turn(*others, side[0]), _turn(*others, side[1])
        apart = _turn(*side, others[0]) * _turn(*side, others[1]) < 0
        for found in np.flatnonzero(apart & (before * after < 0)):
            share = before[found] / (before[found] - after[found])
            return np.asarray(side[0] + share * (side[1] - side[0]))
    return None


def _turn(start: Points, end: Points, point: Points) -> Points:
    """Positive if `point` is on one side of the line from start to end, negative on the other."""
    way, to = end - start, point - start
    return np.asarray(way[..., 0] * to[..., 1] - way[..., 1] * to[..., 0])
