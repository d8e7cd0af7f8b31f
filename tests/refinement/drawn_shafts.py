"""Masks with straight shafts at known places."""

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.geometry import Camera

WIDE = Camera(531, 299, 234.0, 265.5, 149.5)
Point = tuple[float, float]


def drawn(tip: Point, tail: Point, widths: tuple[float, float]) -> NDArray[np.float32]:
    """The mask of `WIDE`'s image of a shaft between two points, px, with a width at each."""
    y, x = np.mgrid[: WIDE.height, : WIDE.width] + 0.5
    length = np.hypot(tail[0] - tip[0], tail[1] - tip[1])
    u, v = (tail[0] - tip[0]) / length, (tail[1] - tip[1]) / length
    along, aside = (x - tip[0]) * u + (y - tip[1]) * v, (y - tip[1]) * u - (x - tip[0]) * v
    half = (widths[0] + along / length * (widths[1] - widths[0])) / 2
    return ((along >= 0) & (along <= length) & (np.abs(aside) <= half)).astype(np.float32)
