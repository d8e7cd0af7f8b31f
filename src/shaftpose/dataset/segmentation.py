"""Segmentations of COCO files, polygons or run lengths, checked and converted to masks."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.core.errors import InputError
from shaftpose.core.masks import RunLengths
from shaftpose.dataset.compressed_masks import CompressedMask

_FARTHEST_PX = 100_000  # pycocotools needs memory for each pixel that a polygon's outline passes

Points = NDArray[np.float64]


def read_segmentation(
    segmentation: Any, size: tuple[int, int], name: str, where: str
) -> CompressedMask | None:
    """The mask of an annotation's `segmentation`; None if it has no pixel in the image.

    Polygons are united; of run lengths, holes are filled and parts of one or two pixels dropped.
    size, name: the image's height and width, and its file's name; where: the value's location.
    Raises InputError naming the location if the value is neither polygons nor run lengths.
    """
    if isinstance(segmentation, dict):
        mask = CompressedMask.of(_without_holes(_pixels(segmentation, size, name, where)))
    elif isinstance(segmentation, list | tuple):
        polygons = [_polygon(points, f"{where}[{n}]") for n, points in enumerate(segmentation)]
        if not polygons:
            return None
        mask = CompressedMask.union(polygons, size)
    else:
        raise InputError(f"{where} = {segmentation!r}: must be a list of polygons or run lengths")
    return mask if mask.area else None


def _pixels(
    encoded: dict[str, Any], size: tuple[int, int], name: str, where: str
) -> NDArray[np.uint8]:
    """The mask (H, W) of COCO's run lengths, whose counts are a list or compressed text."""
    counts = encoded.get("counts") if encoded.get("size") == list(size) else None
    if isinstance(counts, str):
        compressed = CompressedMask(size, counts)
        if compressed.is_valid():
            return compressed.pixels()
    elif isinstance(counts, list) and _fill(counts, size):
        return RunLengths(counts, size).mask().astype(np.uint8)
    raise InputError(
        f"{where}: run lengths need the size {list(size)} of {name} (height, width) and counts "
        "that add up to its pixels; fix them or write polygons"
    )


def _fill(counts: list[Any], size: tuple[int, int]) -> bool:
    """Whether counts are lengths that add up to the pixels of an image."""
    lengths = all(isinstance(count, int) and count >= 0 for count in counts)
    return lengths and sum(counts) == size[0] * size[1]


def _without_holes(mask: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The mask (H, W) with holes filled and without parts of one or two pixels."""
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    parts = [contour for contour in contours if len(contour) >= 3]
    filled = np.zeros(mask.shape, dtype=np.uint8)
    cv2.drawContours(filled, parts, -1, (1,), cv2.FILLED)
    return filled


def _polygon(points: Any, where: str) -> Points:
    """A polygon x, y, x, y, ... Raises InputError if it is damaged or crosses itself."""
    try:
        values = np.array(points, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(
            f"{where}: holds more than numbers; a polygon is x, y, x, y, ..."
        ) from error
    near = np.all(np.abs(values) <= _FARTHEST_PX)  # also False for NaN
    if values.ndim != 1 or values.size % 2 or values.size < 6 or not near:
        raise InputError(
            f"{where}: must hold x and y of three points or more, x, y, x, y, ..., none farther "
            f"than {_FARTHEST_PX:,} px; fix the polygon"
        )
    if (at := _crossing(values)) is not None:
        raise InputError(
            f"{where}: two of its sides cross at x, y = {at[0]:.1f}, {at[1]:.1f}; move its "
            "corners, or write two polygons"
        )
    return values


def _crossing(polygon: Points) -> Points | None:
    """A point (2,) at which two sides of a polygon cross; None if none do.

    Sides that touch or coincide, such as those around a hole, do not cross.
    """
    starts = polygon.reshape(-1, 2)
    ends = np.roll(starts, -1, axis=0)
    for n, side in enumerate(zip(starts, ends, strict=True)):
        others = starts[n + 1 :], ends[n + 1 :]
        before, after = _side_of(*others, side[0]), _side_of(*others, side[1])
        apart = _side_of(*side, others[0]) * _side_of(*side, others[1]) < 0
        for found in np.flatnonzero(apart & (before * after < 0)):
            share = before[found] / (before[found] - after[found])
            return np.asarray(side[0] + share * (side[1] - side[0]))
    return None


def _side_of(start: Points, end: Points, point: Points) -> Points:
    """Positive if `point` is on one side of the line from start to end, negative on the other."""
    line, to_point = end - start, point - start
    return np.asarray(line[..., 0] * to_point[..., 1] - line[..., 1] * to_point[..., 0])
