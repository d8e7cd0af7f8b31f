"""Images with their annotations, rendered or real, read one at a time."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from torch.utils.data import Dataset

from shaftpose.core.instruments import UNKNOWN, Annotations
from shaftpose.core.shards import ShardedDataset
from shaftpose.dataset.batches import LabelledImage
from shaftpose.dataset.coco_images import CocoImage, load_square


class Images(Dataset[LabelledImage], ABC):
    """A sequence of labelled images."""

    @abstractmethod
    def __len__(self) -> int:
        """The number of images."""


@dataclass(frozen=True)
class RenderedImages(Images):
    """Selected images of a rendered dataset, optionally with each pixel's instrument number."""

    shards: ShardedDataset
    keys: Sequence[str]
    with_instances: bool = False

    def __len__(self) -> int:
        """The number of images."""
        return len(self.keys)

    def __getitem__(self, index: int) -> LabelledImage:
        """Image `index` with boxes and poses."""
        key = self.keys[index]
        rgb, known = self.shards.rgb(key), self.shards.annotations(key)
        if not self.with_instances:
            return rgb, known
        instances = np.zeros(rgb.shape[:2], dtype=np.uint8)
        for number, mask in enumerate(self.shards.masks(key), 1):
            instances[mask] = number
        return rgb, replace(known, instances=instances)


@dataclass(frozen=True)
class CocoImages(Images):
    """Real images, with boxes but without poses, optionally with each pixel's instrument number."""

    images: Sequence[CocoImage]
    size_px: int
    with_instances: bool = False

    def __len__(self) -> int:
        """The number of images."""
        return len(self.images)

    def __getitem__(self, index: int) -> LabelledImage:
        """Image `index` with boxes.

        Where a shaft was left out, pixels are `UNKNOWN` and so are all tips; if a shaft has no
        mask, all pixels are.
        """
        sample = load_square(self.images[index], self.size_px)
        instances = None
        if self.with_instances:
            instances = np.zeros(sample.rgb.shape[:2], dtype=np.uint8)
            for number, mask in enumerate(sample.masks, 1):
                instances[mask] = number
            if sample.left_out is not None:
                instances[sample.left_out] = UNKNOWN
            if not all(mask.any() for mask in sample.masks):
                instances[:] = UNKNOWN
        tips = sample.axes[:, 0]
        if sample.left_out is not None:
            tips = np.full_like(tips, np.nan)
        return sample.rgb, Annotations(sample.boxes, None, instances, tips)
