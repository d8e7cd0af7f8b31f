"""Sequences of labelled images, each read from its file when it is asked for."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray
from torch.utils.data import Dataset

from shaftpose.core.errors import InputError
from shaftpose.core.images import Image
from shaftpose.core.instruments import OUTSIDE, TOOL, UNKNOWN, Annotations
from shaftpose.core.shards import ShardedDataset
from shaftpose.dataset.batches import LabelledImage
from shaftpose.dataset.coco_images import CocoImage, SquareImage, load_frame, load_square


class Images(Dataset[LabelledImage], ABC):
    """A sequence of labelled images, rendered or not."""

    @abstractmethod
    def __len__(self) -> int:
        """The number of images."""


@dataclass(frozen=True)
class ImagesInMemory(Images):
    """Images that were all read at once, for loader processes that share memory with this one.

    items: an image, or the error that reading it has raised and asking for it raises again.
    """

    items: Sequence[LabelledImage | InputError]

    @classmethod
    def of(cls, images: Images) -> Self:
        """Read all images; OpenCV decodes those of several threads at the same time."""

        def read(index: int) -> LabelledImage | InputError:
            try:
                return images[index]
            except InputError as error:
                return error

        with ThreadPoolExecutor() as pool:
            return cls(list(pool.map(read, range(len(images)))))

    def __len__(self) -> int:
        """The number of images."""
        return len(self.items)

    def __getitem__(self, index: int) -> LabelledImage:
        """Image `index` and its annotations, which no one may change."""
        item = self.items[index]
        if isinstance(item, InputError):
            raise item
        return item


@dataclass(frozen=True)
class RenderedImages(Images):
    """Selected images of a rendered dataset, with poses.

    with_instances: whether they state each pixel's instrument, and the camera.
    """

    shards: ShardedDataset
    keys: Sequence[str]
    with_instances: bool = False

    def __len__(self) -> int:
        """The number of images."""
        return len(self.keys)

    def __getitem__(self, index: int) -> LabelledImage:
        """Image `index` and its annotations."""
        key = self.keys[index]
        rgb, known = self.shards.rgb(key), self.shards.annotations(key)
        if not self.with_instances:
            return rgb, known
        instances = _instance_map(rgb, self.shards.masks(key))
        instances[self.shards.tool_mask(key)] = TOOL
        camera = self.shards.camera(key)
        if camera.field is not None:
            instances[np.isnan(camera.rays()[..., 0])] = OUTSIDE
        return rgb, replace(known, instances=instances, camera=camera)


@dataclass(frozen=True)
class CocoFrames(Images):
    """COCO's images, whole, without poses, as `load_frame` gives them; short_px: of their shorter
    sides, at most."""

    images: Sequence[CocoImage]
    short_px: int

    def __len__(self) -> int:
        """The number of images."""
        return len(self.images)

    def __getitem__(self, index: int) -> LabelledImage:
        """Image `index` and its annotations."""
        frame = load_frame(self.images[index], self.short_px)
        if frame.field is not None:
            frame.instances[~frame.field] = OUTSIDE
        return frame.rgb, Annotations(frame.boxes, None, frame.instances, frame.tips_px)


@dataclass(frozen=True)
class CocoImages(Images):
    """The central squares of COCO's images, without poses.

    with_instances: whether they state each pixel's instrument number.
    """

    images: Sequence[CocoImage]
    size_px: int
    with_instances: bool = False

    def __len__(self) -> int:
        """The number of images."""
        return len(self.images)

    def __getitem__(self, index: int) -> LabelledImage:
        """Image `index` and its annotations.

        If a shaft was left out, its pixels are `UNKNOWN` and all tips are NaN. If a shaft has no
        mask, all pixels are `UNKNOWN`.
        """
        square = load_square(self.images[index], self.size_px)
        tips_px = square.axes[:, 0]
        if square.left_out is not None:
            tips_px = np.full_like(tips_px, np.nan)
        instances = _instances(square) if self.with_instances else None
        return square.rgb, Annotations(square.boxes, None, instances, tips_px)


def _instances(square: SquareImage) -> NDArray[np.uint8]:
    instances = _instance_map(square.rgb, square.masks)
    if square.left_out is not None:
        instances[square.left_out] = UNKNOWN
    if not all(mask.any() for mask in square.masks):
        instances[:] = UNKNOWN
    return instances


def _instance_map(rgb: Image, masks: Sequence[NDArray[np.bool_]]) -> NDArray[np.uint8]:
    """Each pixel's instrument number (H, W), from 1; 0 for background."""
    instances = np.zeros(rgb.shape[:2], dtype=np.uint8)
    for number, mask in enumerate(masks, 1):
        instances[mask] = number
    return instances
