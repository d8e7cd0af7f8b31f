"""Images annotated without poses: their central squares, and whole frames for training."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.errors import InputError
from shaftpose.core.images import Image, centre_square, resized
from shaftpose.core.instruments import TOOL, TOOL_OR_SHAFT, UNKNOWN
from shaftpose.core.masks import mask_box
from shaftpose.dataset.compressed_masks import CompressedMask
from shaftpose.image_files.reading import read_rgb

Point = tuple[float, float]
UNKNOWN_POINT: Point = (np.nan, np.nan)
_JAWS_WIDTHS = 2.5  # widths of a shaft by which its jaws, not outlined, may reach beyond its tip


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
class CocoTool:
    """One whole instrument: shaft, wrist and jaws.

    mask: of the file's size. shaft_known: whether its shaft is one of the image's instruments, or
    none of it is to be seen.
    """

    mask: CompressedMask
    shaft_known: bool


@dataclass(frozen=True)
class CocoImage:
    """One image file and its shafts, `instruments`.

    crowds: boxes that each hold several shafts; they have no masks. tools: whole instruments, where
    the file outlines them. field: corners of the visible field, px; None if it is not stated.
    operation: that the image is of, or its own name if that is not stated.
    """

    path: Path
    width: int
    height: int
    instruments: tuple[CocoInstrument, ...]
    crowds: tuple[CocoInstrument, ...] = ()
    tools: tuple[CocoTool, ...] = ()
    field: tuple[Point, ...] | None = None
    operation: str = ""


@dataclass(frozen=True)
class SquareImage:
    """A square image without poses, as the networks see it.

    rgb: (S, S, 3); boxes: (G, 4) px; masks: G of (S, S); axes: (G, 2, 2) px, NaN where unknown;
    occluded: whether one of the instruments is; left_out: (S, S), the pixels of dropped
    instruments, of the boxes of crowds and of tools whose shaft is unknown, None if there are none.
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
    for tool in image.tools:
        if not tool.shaft_known:
            left_out |= centre_square(tool.mask.pixels(), size_px).astype(bool)
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
    return centre_square(covered(instrument, image), size_px).astype(bool)


def covered(instrument: CocoInstrument, image: CocoImage) -> NDArray[np.uint8]:
    """The pixels (H, W) of an instrument of an image, 1 inside; of its box if it has no mask."""
    if instrument.mask is not None:
        return instrument.mask.pixels()
    x0, y0, x1, y1 = np.rint(instrument.box).astype(int)
    whole = np.zeros((image.height, image.width), dtype=np.uint8)
    whole[y0:y1, x0:x1] = 1
    return whole


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


@dataclass(frozen=True)
class FrameImage:
    """A whole frame without poses, scaled for training.

    rgb: (h, w, 3). instances: (h, w), each pixel's shaft, 1, 2, ..., G; 0 for background, `TOOL`,
    `TOOL_OR_SHAFT` or `UNKNOWN`. boxes: (G, 4) px; tips_px: (G, 2) px, NaN where unknown. field:
    (h, w), the visible field, None if it is not stated.
    """

    rgb: Image
    instances: NDArray[np.uint8]
    boxes: NDArray[np.float64]
    tips_px: NDArray[np.float64]
    field: NDArray[np.bool_] | None


def load_frame(image: CocoImage, short_px: int) -> FrameImage:
    """The whole frame, its shorter side scaled down to `short_px`; smaller frames keep their size.

    Shafts without a mask are no rows of the arrays; their boxes are `UNKNOWN`, as those of crowds.
    Where no whole tools are outlined, so are the pixels in front of all tips: jaws may be there.
    """
    rgb = read_pixels(image)
    shrink = min(1.0, short_px / min(image.width, image.height))
    width, height = round(image.width * shrink), round(image.height * shrink)
    scale = np.array([width / image.width, height / image.height])
    shafts = [shaft for shaft in image.instruments if shaft.mask is not None]
    tips = np.array([shaft.axis[0] for shaft in shafts]).reshape(-1, 2) * scale
    return FrameImage(
        rgb=resized(rgb, width, height),
        instances=_frame_instances(image, scale, (height, width)),
        boxes=np.array([shaft.box for shaft in shafts]).reshape(-1, 4) * np.tile(scale, 2),
        tips_px=tips,
        field=None
        if image.field is None
        else _inside(np.array(image.field) * scale, (height, width)),
    )


def _frame_instances(
    image: CocoImage, scale: NDArray[np.float64], size: tuple[int, int]
) -> NDArray[np.uint8]:
    """The map (h, w) of a frame scaled to `size`, by `scale` along x and y: shafts over tools, and
    what nobody has annotated over both."""

    def scaled(mask: NDArray[np.uint8]) -> NDArray[np.bool_]:
        return resized(mask, size[1], size[0]).astype(bool)

    shafts = [(shaft, scaled(covered(shaft, image))) for shaft in image.instruments]
    instances = np.zeros(size, dtype=np.uint8)
    if not image.tools:
        for shaft, area in shafts:
            instances[_in_front(area, np.array(shaft.axis[0]) * scale)] = UNKNOWN
    for tool in sorted(image.tools, key=lambda tool: not tool.shaft_known):
        instances[scaled(tool.mask.pixels())] = TOOL if tool.shaft_known else TOOL_OR_SHAFT
    outlined = (area for shaft, area in shafts if shaft.mask is not None)
    for number, area in enumerate(outlined, 1):
        instances[area] = number
    for area in (
        *(scaled(covered(crowd, image)) for crowd in image.crowds),
        *(area for shaft, area in shafts if shaft.mask is None),
    ):
        instances[area] = UNKNOWN
    return instances


def _inside(polygon: NDArray[np.float64], size: tuple[int, int]) -> NDArray[np.bool_]:
    """The pixels of an image of `size` (h, w) inside a polygon (N, 2), px."""
    return CompressedMask.union([polygon.ravel()], size).pixels().astype(bool)


def _in_front(mask: NDArray[np.bool_], tip: NDArray[np.float64]) -> NDArray[np.bool_]:
    """The pixels (h, w) in front of a tip, no farther from it than 2.5 widths of its shaft.

    The mask's centroid lies half a length behind the tip. No pixel if the tip is NaN or the mask
    empty.
    """
    rows, columns = np.nonzero(mask)
    if not len(rows) or np.isnan(tip).any():
        return np.zeros_like(mask)
    forward = tip - np.array([columns.mean(), rows.mean()]) - 0.5
    half_length = max(float(np.hypot(*forward)), 1.0)
    width = len(rows) / (2 * half_length)
    y, x = np.indices(mask.shape) + 0.5
    x, y = x - tip[0], y - tip[1]
    return (x * forward[0] + y * forward[1] > 0) & (np.hypot(x, y) <= _JAWS_WIDTHS * width)
