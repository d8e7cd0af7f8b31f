"""Rectangles of the image that Blender renders: one around a diagonal shaft is mostly empty.

Each render has a fixed cost, and each pixel costs time, even an empty one. A rectangle is therefore
split where that saves more pixels than one more render costs.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.core.geometry import Array, Camera
from shaftpose.core.masks import mask_box
from shaftpose.rendering.meshes import Mesh

Mask = NDArray[np.bool_]

# Margin of the rendered region: the pixel filter reaches beyond a mesh's edge.
_MARGIN_PX = 3
_NEAR_MM = 0.1


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


def touched_pixels(camera: Camera, bodies: Iterable[tuple[Mesh, Array]]) -> Mask:
    """Mask (H, W) of pixels that one of the bodies may touch, plus a margin.

    bodies: meshes, and the matrix (4, 4) from each one's frame to the camera's.
    """
    touched = np.zeros((camera.height, camera.width), dtype=np.uint8)
    for mesh, matrix in bodies:
        points = mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3]
        outline = projected_outline(camera, points, mesh.edges)
        if outline is not None:
            cv2.fillConvexPoly(touched, np.floor(outline).astype(np.int32), (1,))
    margin = np.ones((2 * _MARGIN_PX + 1, 2 * _MARGIN_PX + 1), dtype=np.uint8)
    return np.asarray(cv2.dilate(touched, margin), dtype=bool)


def projected_outline(
    camera: Camera, points_mm: Array, edges: NDArray[np.int64]
) -> NDArray[np.float32] | None:
    """Corners (N, 2), px, of a mesh's projected convex hull, clipped to the image.

    points_mm: (V, 3) in the camera frame; edges are clipped at the near plane, so a shaft that
    passes next to the camera is handled. None if the mesh is out of view.
    """
    start, end = points_mm[edges[:, 0]], points_mm[edges[:, 1]]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (_NEAR_MM - start[:, 2]) / (end[:, 2] - start[:, 2])
    crossing = (start[:, 2] - _NEAR_MM) * (end[:, 2] - _NEAR_MM) < 0
    cuts = start[crossing] + share[crossing, None] * (end[crossing] - start[crossing])
    visible = np.concatenate([points_mm[points_mm[:, 2] >= _NEAR_MM], cuts])
    if not len(visible):
        return None
    hull = cv2.convexHull(camera.project(visible).astype(np.float32))
    width, height = camera.width, camera.height
    frame = np.array([[0, 0], [width, 0], [width, height], [0, height]], dtype=np.float32)
    # Far corners would be drawn some pixels off: OpenCV fills polygons with integer corners.
    area, outline = cv2.intersectConvexConvex(hull, frame)
    return np.asarray(outline, dtype=np.float32).reshape(-1, 2) if area > 0 else None


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
