"""The visible field of a frame: the picture of the scope within black borders and overlays."""

from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.core.geometry import Array, Camera, Disc
from shaftpose.core.images import Image

_LONG_PX = 240  # longer side of the image in which a field is looked for
# The threshold between picture and black border: `_ABOVE_BLACK` above the darkest pixels, between
# the two limits; compression blurs what is black.
LEAST_LEVEL, _ABOVE_BLACK, _MOST_LEVEL = 18, 12, 40
_LEAST_SHARE = 0.05  # of the frame
_LARGE = 0.2  # area of a region of the field, relative to that of the largest one
_BORDER_PX = 2.5  # within this of the frame's border, an outline is the frame's, not the disc's
_FULL = 0.97  # share of its bounding box that a rectangular field fills at least
_TRIALS, _NEAR_PX, _LEAST_IOU = 60, 1.2, 0.95  # of the disc


class VisibleField(NamedTuple):
    """The visible part of an image. box: x0, y0, x1, y1 in whole px; disc: only what it covers of
    the box is visible, None for all of the box."""

    box: tuple[int, int, int, int]
    disc: Disc | None = None


class Picture(NamedTuple):
    """A model's image (h, w, 3), the same in k times the pixels a side or None, and the camera that
    sees both, in px of the first."""

    rgb: Image
    fine: Image | None
    camera: Camera

    def within(self, field: VisibleField) -> "Picture":
        """The picture of a field alone: cut to its box, and black outside its disc."""
        x0, y0, x1, y1 = field.box
        camera = replace(self.camera, field=field.disc).cropped(x0, y0, x1 - x0, y1 - y0)
        rgb, fine = _darkened(self.rgb[y0:y1, x0:x1], camera.field, 1), None
        if self.fine is not None:
            times = self.fine.shape[0] // self.rgb.shape[0]
            part = self.fine[times * y0 : times * y1, times * x0 : times * x1]
            fine = _darkened(part, camera.field, times)
        return Picture(rgb, fine, camera)


def _darkened(rgb: Image, disc: Disc | None, times: int) -> Image:
    """An image, black outside a disc in `times` smaller pixels."""
    if disc is None:
        return np.ascontiguousarray(rgb)
    inside = np.zeros(rgb.shape[:2], np.uint8)
    at, bits = disc.enlarged(times), 4
    centre = [round((value - 0.5) * 2**bits) for value in (at.x, at.y)]
    cv2.circle(inside, centre, round(at.diameter / 2 * 2**bits), (255,), cv2.FILLED, 8, bits)
    return np.asarray(cv2.bitwise_and(rgb, rgb, mask=inside), np.uint8)


def visible_field(rgb: Image) -> VisibleField | None:
    """The visible field of an image (H, W, 3); None if nearly all of it is black.

    The first that fits of: the convex hull of all large bright regions, as a rectangle or a disc
    (dark organs and instruments may part the picture); that of the largest region, as a rectangle,
    or as a disc whose centre it holds (the others are texts and panels in the border); the bounding
    box of the first hull.
    """
    height, width = rgb.shape[:2]
    scale = min(_LONG_PX / max(height, width), 1.0)
    size = max(round(width * scale), 1), max(round(height * scale), 1)
    level = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA).max(axis=2)
    per_px, fields = np.array([width / size[0], height / size[1]]), list[VisibleField]()
    for outline in _outlines(np.asarray(level, np.uint8)):
        shown = np.zeros(level.shape, np.uint8)
        cv2.fillConvexPoly(shown, outline, (1,))
        low, high = outline.min(axis=0), outline.max(axis=0) + 1
        box = _snapped(low * per_px, high * per_px, per_px, np.array([width, height]))
        if shown.sum() >= _FULL * np.prod(high - low):
            return VisibleField(box)
        if (disc := _disc(shown)) is not None:
            at = np.array([disc.x, disc.y])
            # One side of a dark instrument may look like a part of a disc, far from its centre.
            if not fields or np.all((low < at) & (at < high)):
                x, y = at * per_px
                diameter = float(disc.diameter * per_px.mean())
                return VisibleField(box, Disc(float(x), float(y), diameter))
        fields.append(VisibleField(box))
    return fields[0] if fields else None


def _outlines(level: NDArray[np.uint8]) -> list[NDArray[np.int32]]:
    """The convex outlines (N, 2) of the large bright regions together and of the largest one, pixel
    indices, without those of too few pixels."""
    threshold = np.clip(np.percentile(level, 1) + _ABOVE_BLACK, LEAST_LEVEL, _MOST_LEVEL)
    bright = cv2.morphologyEx(
        (level > threshold).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)
    )
    _, regions, statistics, _ = cv2.connectedComponentsWithStats(bright)
    areas = statistics[1:, cv2.CC_STAT_AREA]
    most = areas.max(initial=0)
    chosen = [np.flatnonzero(areas >= least) for least in (_LARGE * most, most)]
    points = [
        np.argwhere(np.isin(regions, 1 + large))[:, ::-1].astype(np.int32)
        for large in chosen
        if areas[large].sum() >= _LEAST_SHARE * level.size
    ]
    return [np.asarray(cv2.convexHull(one)[:, 0], np.int32) for one in points]


def _snapped(low: Array, high: Array, per_px: Array, size: Array) -> tuple[int, int, int, int]:
    """A box in whole pixels; its sides next to the frame's border lie on it."""
    low = np.where(low <= 2 * per_px, 0, low)
    high = np.where(high >= size - 2 * per_px, size, high)
    x0, y0, x1, y1 = (int(value) for value in (*np.floor(low), *np.ceil(high)))
    return x0, y0, x1, y1


def _disc(shown: NDArray[np.uint8]) -> Disc | None:
    """The disc of which a region (h, w) is the visible part; None if it has another shape.

    RANSAC: of many circles through three points of the outline, the one nearest to most of them is
    taken; the disc is fitted to the points near it by least squares.
    """
    height, width = shown.shape
    (outline, *_), _ = cv2.findContours(shown, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    points = outline[:, 0] + 0.5
    border = np.minimum(points, [width, height] - points).min(axis=1)
    points = points[border > _BORDER_PX]
    if len(points) < 20:
        return None
    rng = np.random.default_rng(0)
    triples = (points[rng.choice(len(points), 3, replace=False)] for _ in range(_TRIALS))
    near = [_distances(points, _circle(three)) < _NEAR_PX for three in triples]
    x, y, radius = _circle(points[max(near, key=np.count_nonzero)])
    at_y, at_x = np.mgrid[:height, :width] + 0.5
    inside = np.hypot(at_x - x, at_y - y) <= radius
    same, either = inside & (shown > 0), inside | (shown > 0)
    if not np.isfinite(radius) or same.sum() < _LEAST_IOU * either.sum():
        return None
    return Disc(x, y, 2 * radius)


def _circle(points: Array) -> tuple[float, float, float]:
    """Centre and radius of the circle nearest to points (N, 2), by linear least squares."""
    rows = np.column_stack([2 * points, np.ones(len(points))])
    x, y, rest = np.linalg.lstsq(rows, (points**2).sum(axis=1), rcond=None)[0].tolist()
    return x, y, float(np.sqrt(max(rest + x**2 + y**2, 0.0)))


def _distances(points: Array, circle: tuple[float, float, float]) -> Array:
    x, y, radius = circle
    return np.abs(np.hypot(points[:, 0] - x, points[:, 1] - y) - radius)
