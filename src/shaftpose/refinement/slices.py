"""Slices across lines through a mask: is there more mask inside a shaft than beside it?"""

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.geometry import Array, Camera
from shaftpose.refinement.ridges import Lines

# Where a slice is read: inside, in half widths, and beside.
_INSIDE = np.array([-0.8, -0.4, 0.0, 0.4, 0.8])
_BESIDE, _BESIDE_PX = np.array([-1.25, 1.25]), np.array([-2.0, 2.0])


def visible(mask: NDArray[np.float32], camera: Camera) -> NDArray[np.bool_]:
    """The pixels of a mask (H, W) in the visible field of the camera that sees it."""
    disc, (height, width) = camera.field, mask.shape
    if disc is None:
        return np.ones(mask.shape, dtype=bool)
    x, y = np.arange(width) + 0.5 - disc.x, np.arange(height) + 0.5 - disc.y
    return np.asarray(y[:, None] ** 2 + x**2 <= disc.diameter**2 / 4)


def slice_contrasts(
    mask: NDArray[np.float32], known: NDArray[np.bool_], lines: Lines, along: Array
) -> tuple[Array, Array]:
    """Contrasts (L, S) of slices across lines at distances (L, S) along them, and their weights.

    The contrast is the mean mask (H, W) inside minus that beside, where the mask is `known` (H, W);
    the weight is the share of the inside that is known, 0 if nothing beside is.
    """
    halves = np.maximum(lines.halves_at(along), 0.0)[..., None]
    centres = lines.points[:, None] + along[..., None] * lines.directions[:, None]

    def read(places: Array) -> tuple[Array, NDArray[np.intp]]:
        at = centres[:, :, None] + places[..., None] * lines.normals[:, None, None]
        return _means(mask, known, at)

    inside, counted = read(halves * _INSIDE)
    beside, counted_beside = read(halves * _BESIDE + _BESIDE_PX)
    return inside - beside, counted / len(_INSIDE) * (counted_beside > 0)


def _means(
    mask: NDArray[np.float32], known: NDArray[np.bool_], at: Array
) -> tuple[Array, NDArray[np.intp]]:
    """The means (...) of a mask at points (..., N, 2) px where it is known, and their numbers."""
    height, width = mask.shape
    x, y = np.floor(at[..., 0]).astype(np.intp), np.floor(at[..., 1]).astype(np.intp)
    within = (x >= 0) & (y >= 0) & (x < width) & (y < height)
    x, y = x * within, y * within
    counts = known[y, x] & within
    number = np.count_nonzero(counts, axis=-1)
    return (mask[y, x] * counts).sum(axis=-1) / np.maximum(number, 1), number
