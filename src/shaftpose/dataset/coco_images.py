"""Images annotated without poses, and their central squares as the networks see them."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.errors import InputError
from shaftpose.core.images import Image, centre_square, read_rgb
from shaftpose.core.masks import mask_box
from shaftpose.dataset.compressed_masks import CompressedMask

Point = tuple[float, float]
UNKNOWN_POINT: Point = (np.nan, np.nan)


@dataclass(frozen=True)
class CocoInstrument:
    """One annotated shaft; all coordinates are px of the image file.

    box: x0, y0, x1, y1. mask: of the file's size; None where only the box is known. axis: the tip,
    and another point of the axis towards the handle; NaN where unknown.
    """

    box: tuple[float, float, float, float]
    mask: CompressedMask | None
    occluded: bool
    axis: tuple[Point, Point] = (UNKNOWN_POINT, UNKNOWN_POINT)


@dataclass(frozen=True)
class CocoImage:
    """One image file and its instruments.

    crowds: boxes that each hold several instruments; they have no masks.
    """

    path: Path
    width: int
    height: int
    instruments: tuple[CocoInstrument, ...]
    crowds: tuple[CocoInstrument, ...] = ()


@dataclass(frozen=True)
class SquareImage:
    """A square image without poses, as the networks see it.

    rgb: (S, S, 3); boxes: (G, 4) px; masks: G of (S, S); axes: (G, 2, 2) px, NaN where unknown;
    occluded: whether one of the instruments is; left_out: (S, S), the pixels of dropped instruments
    and of the boxes of crowds, None if there are none.
    """

    rgb: Image
    boxes: NDArray[np.float64]
    masks: tuple[NDArray[np.bool_], ...]
    axes: NDArray[np.float64]
    occluded: bool
    left_out: NDArray[np.bool_] | None = None


def read_pixels(image: CocoImage) -> Image:
    """The image (H, W, 3). Raises InputError naming it if it is damaged or of another size than its
    entry states."""
    rgb = read_rgb(image.path)
    if rgb.shape[:2] != (image.height, image.width):
        raise InputError(
            f"{image.path}: has {rgb.shape[1]} x {rgb.shape[0]} px, its COCO entry says "
            f"{image.width} x {image.height}; fix the entry"
        )
    return rgb


def load_square(image: CocoImage, size_px: int) -> SquareImage:
    """The central square of an image, resized to size_px, with its annotations clipped to it.

    The box of an instrument with a mask becomes the extent of the clipped mask; other boxes are
    clipped themselves. Drops an instrument if less than a fifth of its box, or nothing of its mask,
    lies in the square.
    """
    rgb = read_pixels(image)
    boxes, masks, axes, occluded = [], [], [], False
    left_out = np.zeros((size_px, size_px), dtype=bool)
    for crowd in image.crowds:
        left_out |= _pixels(crowd, image, size_px)
    side, corner = _central_square(image)
    for instrument in image.instruments:
        part = _in_square(instrument, image, size_px)
        if part is not None:
            boxes.append(part[0])
            masks.append(part[1])
            axes.append((np.array(instrument.axis) - corner) * size_px / side)
            occluded |= instrument.occluded
        else:
            left_out |= _pixels(instrument, image, size_px)
    return SquareImage(
        rgb=centre_square(rgb, size_px),
        boxes=np.array(boxes, dtype=np.float64).reshape(-1, 4),
        masks=tuple(masks),
        axes=np.array(axes, dtype=np.float64).reshape(-1, 2, 2),
        occluded=occluded,
        left_out=left_out if left_out.any() else None,
    )


def _central_square(image: CocoImage) -> tuple[int, NDArray[np.int64]]:
    """Side and upper left corner (2,) of the central square, px."""
    side = min(image.width, image.height)
    return side, (np.array([image.width, image.height]) - side) // 2


def _pixels(instrument: CocoInstrument, image: CocoImage, size_px: int) -> NDArray[np.bool_]:
    """The pixels (S, S) of an instrument in the resized square, of its box if it has no mask."""
    if instrument.mask is not None:
        whole = instrument.mask.pixels()
    else:
        x0, y0, x1, y1 = np.rint(instrument.box).astype(int)
        whole = np.zeros((image.height, image.width), dtype=np.uint8)
        whole[y0:y1, x0:x1] = 1
    return centre_square(whole, size_px).astype(bool)


def _in_square(
    instrument: CocoInstrument, image: CocoImage, size_px: int
) -> tuple[NDArray[np.float64], NDArray[np.bool_]] | None:
    """Box (4,) px and mask (S, S) in the resized square; None if the instrument is dropped."""
    side, corner = _central_square(image)
    whole = np.array(instrument.box).reshape(2, 2) - corner
    box = np.clip(whole, 0, side)
    if np.prod(box[1] - box[0]) < 0.2 * np.prod(whole[1] - whole[0]):
        return None
    if instrument.mask is None:
        return box.ravel() * size_px / side, np.zeros((size_px, size_px), dtype=bool)
    cut = centre_square(instrument.mask.pixels(), side)
    mask = centre_square(cut, size_px).astype(bool)
    return (np.array(mask_box(cut.astype(bool))) * size_px / side, mask) if mask.any() else None
