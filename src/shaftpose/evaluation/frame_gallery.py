"""Pictures of the frames in which a model misses most shafts, or finds most that are not there."""

from collections.abc import Sequence

import cv2
import numpy as np

from shaftpose.core.images import Image
from shaftpose.dataset.coco_images import CocoImage, read_pixels
from shaftpose.evaluation.true_shafts import true_shafts
from shaftpose.evaluation.whole_frames import FrameModel
from shaftpose.figures.drawing import (
    FOUND,
    TRUTH,
    Colour,
    contact_sheet,
    draw_caption,
    draw_masks,
)
from shaftpose.metrics.frames.comparison import ComparedFrame
from shaftpose.metrics.image_metrics import Mask

DRAWN, COLUMNS = 12, 4
WIDTH, HEIGHT = 360, 270  # of each picture


def gallery(
    model: FrameModel, images: Sequence[CocoImage], frames: Sequence[ComparedFrame], title: str
) -> Image | None:
    """The images with the most missed and false segments, the worst first: true masks in green,
    found ones in yellow. frames: the images, compared; title: begins each caption. None if all
    shafts are found, and no other.
    """
    errors = np.array([errors_of(frame) for frame in frames]).reshape(-1, 2)
    worst = np.argsort(-errors.sum(axis=1), kind="stable")[:DRAWN]
    tiles = [
        draw_caption(
            _drawn(model, images[n]), f"{title}: {errors[n, 0]} missed, {errors[n, 1]} false"
        )
        for n in worst
        if errors[n].any()
    ]
    return contact_sheet(tiles, COLUMNS) if tiles else None


def errors_of(frame: ComparedFrame) -> tuple[int, int]:
    """The numbers of shafts that no segment hits, and of segments that hit no shaft."""
    hits = frame.hits["segment"]
    missed = len(frame.counted["segment"]) - np.count_nonzero(hits >= 0)
    return missed, np.count_nonzero(frame.sure & (hits < 0) & ~frame.neutral)


def _drawn(model: FrameModel, image: CocoImage) -> Image:
    """The image in the upper left corner of a tile, with its shafts and those surely found."""
    found = model(image)
    sure = [found.masks[n] for n in np.flatnonzero(found.scores >= model.threshold)]
    small = _outlined(_small(read_pixels(image)), true_shafts(image).masks, TRUTH)
    small = _outlined(small, sure, FOUND)
    tile = np.zeros((HEIGHT, WIDTH, 3), dtype=np.uint8)
    tile[: small.shape[0], : small.shape[1]] = small
    return tile


def _outlined(small: Image, masks: Sequence[Mask], colour: Colour) -> Image:
    shrunk = [_small(np.where(mask, 255, 0).astype(np.uint8)) > 127 for mask in masks]
    return draw_masks(small, shrunk, colour)


def _small(picture: Image) -> Image:
    """A picture, or a mask of 0 and 255, as large as a tile holds."""
    height, width = picture.shape[:2]
    scale = min(WIDTH / width, HEIGHT / height)
    size = round(scale * width), round(scale * height)
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
