"""Rectangles of the image that Blender renders: one around a diagonal shaft is mostly empty.

Each render has a fixed cost, and each pixel costs time, even an empty one. A rectangle is therefore
split where that saves more pixels than one more render costs.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.masks import mask_box

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Region:
    """A rectangle of the image, in whole pixels."""

    x0: int
    y0: int
    x1: int
    y1: int

    @property
    def slices(self) -> tuple[slice, slice]:
        """Rows and columns, for indexing an (H, W) array."""
        return slice(self.y0, self.y1), slice(self.x0, self.x1)


def cover(mask: Mask, render_px: float) -> list[Region]:
    """Disjoint rectangles that cover all pixels of `mask` (H, W).

    render_px: the cost of one more render, in pixels.
    """
    return list(_cover(mask, render_px, 0, 0))


def _cover(mask: Mask, render_px: float, left: int, top: int) -> Iterator[Region]:
    """The rectangles of a part of the image whose corner is (left, top)."""
    if not mask.any():
        return
    x0, y0, x1, y1 = mask_box(mask)
    mask, left, top = mask[y0:y1, x0:x1], left + x0, top + y0
    across, column = _best_cut(mask)
    down, row = _best_cut(mask.T)
    if min(across, down) + render_px >= mask.size:
        yield Region(left, top, left + mask.shape[1], top + mask.shape[0])
    elif across <= down:
        yield from _cover(mask[:, :column], render_px, left, top)
        yield from _cover(mask[:, column:], render_px, left + column, top)
    else:
        yield from _cover(mask[:row], render_px, left, top)
        yield from _cover(mask[row:], render_px, left, top + row)


def _best_cut(mask: Mask) -> tuple[int, int]:
    """The smallest area of two rectangles, left and right, that cover a mask (h, w), and the
    column at which the second one starts."""
    height, width = mask.shape
    if width < 2:
        return mask.size, 0
    rows = np.arange(height)[:, None]
    first = np.where(mask, rows, height).min(axis=0)  # of each column
    end = np.where(mask, rows + 1, 0).max(axis=0)
    before, after = _heights(first, end), _heights(first[::-1], end[::-1])[::-1]
    columns = np.arange(1, width)
    areas = columns * before[:-1] + (width - columns) * after[1:]
    best = int(np.argmin(areas))
    return int(areas[best]), best + 1


def _heights(first: NDArray[np.int64], end: NDArray[np.int64]) -> NDArray[np.int64]:
    """Heights of the rectangles around all columns up to each one; 0 where they are empty."""
    heights = np.maximum.accumulate(end) - np.minimum.accumulate(first)
    return np.maximum(heights, 0)
