"""Random views of training images: other zooms, places, turns and visible fields.

A zoomed, turned and shifted image is what a pinhole camera of another focal length and principal
point sees, so poses stay exact. Images without poses may also be stretched.
"""

from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.core.geometry import Array, Camera, unsigned_deg
from shaftpose.core.images import Image
from shaftpose.core.instruments import OUTSIDE, Annotations
from shaftpose.core.masks import mask_box

_UNCHANGED = 0.4  # share of the rendered images that stay as they are
_ZOOMS = 0.8, 2.5
_FRAME_ZOOMS = 0.8, 2.2  # of images without poses, relative to the whole frame
_STRETCH = 0.35  # logarithm of the most by which width and height change
_AT_INSTRUMENT = 0.7  # share of the zoomed views that are centred near an instrument
_ASIDE = 0.3  # the most by which its place differs from the centre, relative to the side
_LEAST_COVERED, _TRIES, _GRID = 0.6, 10, 20  # share of a view that the image covers, points a side
_ROUND = 0.25  # share of the views with a round field
_DIAMETERS, _CENTRE = (0.75, 1.25), 0.12  # relative to the side
_BLURRED, _BLUR_PX = 0.3, (0.3, 1.3)  # share and standard deviation: renders are grainy


def random_view(
    rgb: Image, known: Annotations, side: int, rng: np.random.Generator
) -> tuple[Image, Annotations]:
    """A random view (side, side, 3) of an image (H, W, 3) with its map of instruments.

    Pixels that the image does not cover, or outside a round field, are black and `OUTSIDE`. Shafts
    may leave the view: their boxes are empty then. Images of distorting lenses with poses are not
    warped, because no pose fits the warped image.
    """
    assert known.instances is not None
    if known.poses is None or _changeable(known.camera, rng):
        rgb, known = _warped(rgb, known, side, rng)
    if rng.random() < _ROUND:
        known = _rounded(known, rng)
    if rng.random() < _BLURRED:
        rgb = np.asarray(cv2.GaussianBlur(rgb, (0, 0), rng.uniform(*_BLUR_PX)), np.uint8)
    assert known.instances is not None
    return np.where((known.instances != OUTSIDE)[..., None], rgb, np.uint8(0)), known


def _changeable(camera: Camera | None, rng: np.random.Generator) -> bool:
    assert camera is not None
    return not (camera.k1 or camera.k2) and rng.random() >= _UNCHANGED


class _Placement(NamedTuple):
    """Where a view lies: matrix, (2, 3), from px of the image to px of the view; its zoom relative
    to the whole image, and its turn in radians."""

    matrix: Array
    zoom: float
    turn: float


def _warped(
    rgb: Image, known: Annotations, side: int, rng: np.random.Generator
) -> tuple[Image, Annotations]:
    """Zoomed, turned and shifted; without poses also stretched."""
    assert known.instances is not None
    place = _place(known.instances, known.poses is not None, side, rng)
    matrix = _of_indices(place.matrix)
    image = np.asarray(cv2.warpAffine(rgb, matrix, (side, side)), np.uint8)
    instances = np.asarray(
        cv2.warpAffine(
            np.ascontiguousarray(known.instances), matrix, (side, side),
            flags=cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=(OUTSIDE,),
        ),
        np.uint8,
    )  # fmt: skip
    moved = known if known.camera is None else _seen(known, known.camera, place, side)
    tips = None if known.tips_px is None else _mapped(place.matrix, known.tips_px)
    boxes = _boxes(instances, len(known.boxes))
    return image, replace(moved, boxes=boxes, instances=instances, tips_px=tips)


def _place(
    instances: NDArray[np.uint8], rendered: bool, side: int, rng: np.random.Generator
) -> _Placement:
    """The first of a few random places of which the image covers enough, or the last."""
    for _ in range(_TRIES):
        place = _random_place(instances, rendered, side, rng)
        if _covered(instances, place.matrix, side) >= _LEAST_COVERED:
            break
    return place


def _random_place(
    instances: NDArray[np.uint8], rendered: bool, side: int, rng: np.random.Generator
) -> _Placement:
    zoom = float(np.exp(rng.uniform(*np.log(_ZOOMS if rendered else _FRAME_ZOOMS))))
    turn = float(rng.uniform(0, 2 * np.pi))
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    stretch = 1.0 if rendered else float(np.exp(rng.uniform(-_STRETCH, _STRETCH) / 2))
    scale = zoom * side / min(instances.shape)
    linear = scale * rotation @ np.diag([stretch, 1 / stretch])
    target = side * (0.5 + rng.uniform(-_ASIDE, _ASIDE, 2))
    shift = target - linear @ _focus(instances, zoom, rng)
    return _Placement(np.column_stack([linear, shift]), zoom, turn)


def _covered(instances: NDArray[np.uint8], matrix: Array, side: int) -> float:
    """The share of a view's points that lie in the visible field of the image."""
    steps = (np.arange(_GRID) + 0.5) * side / _GRID
    points = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    x, y = np.floor(np.linalg.solve(matrix[:, :2], (points - matrix[:, 2]).T)).astype(int)
    inside = (x >= 0) & (y >= 0) & (x < instances.shape[1]) & (y < instances.shape[0])
    return float(np.sum(instances[y[inside], x[inside]] != OUTSIDE) / len(points))


def _focus(instances: NDArray[np.uint8], zoom: float, rng: np.random.Generator) -> Array:
    """The point (2,) px that comes near the view's centre: on an instrument, or anywhere."""
    height, width = instances.shape
    on_instrument = np.flatnonzero((instances > 0) & (instances != OUTSIDE))
    if len(on_instrument) and rng.random() < _AT_INSTRUMENT:
        y, x = np.unravel_index(rng.choice(on_instrument), instances.shape)
        return np.array([x + 0.5, y + 0.5])
    spread = max(1 - 1 / zoom, 0.0)  # no farther than the view still lies within the image
    return np.array([width, height]) * (0.5 + spread * rng.uniform(-0.5, 0.5, 2))


def _seen(known: Annotations, camera: Camera, place: _Placement, side: int) -> Annotations:
    """The poses, turned, and the camera of a zoomed, turned and shifted image."""
    assert known.poses is not None
    x, y = _mapped(place.matrix, np.array([camera.cx, camera.cy])).tolist()
    focal_px = camera.focal_px * place.zoom * side / min(camera.width, camera.height)
    poses, (c, s) = known.poses.copy(), (np.cos(place.turn), np.sin(place.turn))
    poses[:, :2] = poses[:, :2] @ np.array([[c, s], [-s, c]])
    poses[:, 4] = unsigned_deg(poses[:, 4] + np.degrees(place.turn))
    return replace(known, poses=poses, camera=Camera(side, side, focal_px, x, y))


def _mapped(matrix: Array, points: Array) -> Array:
    """Points (..., 2) px, mapped by (2, 3)."""
    return np.asarray(points @ matrix[:, :2].T + matrix[:, 2])


def _rounded(known: Annotations, rng: np.random.Generator) -> Annotations:
    """The annotations of an image that a round field cuts."""
    assert known.instances is not None
    side = len(known.instances)
    x, y = side * (0.5 + rng.uniform(-_CENTRE, _CENTRE, 2))
    radius = side * rng.uniform(*_DIAMETERS) / 2
    rows, columns = np.ogrid[:side, :side]
    outside = (columns + 0.5 - x) ** 2 + (rows + 0.5 - y) ** 2 > radius**2
    instances = np.where(outside, np.uint8(OUTSIDE), known.instances)
    return replace(known, boxes=_boxes(instances, len(known.boxes)), instances=instances)


def _boxes(instances: NDArray[np.uint8], count: int) -> Array:
    """The boxes (count, 4) of the shafts in a map; empty ones of those that have left it."""
    masks = (instances == number for number in range(1, count + 1))
    boxes = [mask_box(mask) if mask.any() else (0, 0, 0, 0) for mask in masks]
    return np.array(boxes, np.float64).reshape(-1, 4)


def _of_indices(matrix: Array) -> Array:
    """The same map for OpenCV, which has the centre of pixel 0 at 0, not at 0.5 px."""
    linear, shift = matrix[:, :2], matrix[:, 2]
    return np.column_stack([linear, shift + linear @ [0.5, 0.5] - 0.5])
