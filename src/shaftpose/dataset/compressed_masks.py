"""Masks as COCO's compressed run lengths, which pycocotools reads and writes."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pycocotools import mask as coco_mask

# Numbers of one to six characters, of which the last is one of 0 to O. Without it, pycocotools
# reads beyond the end of the text.
_NUMBERS = re.compile("([P-o]{0,5}[0-O])+")


@dataclass(frozen=True)
class CompressedMask:
    """A mask; size: height and width, counts: its compressed run lengths."""

    size: tuple[int, int]
    counts: str

    @classmethod
    def of(cls, mask: NDArray[Any]) -> "CompressedMask":
        """The mask (H, W) of zeros and ones, compressed."""
        return cls._of_coco(coco_mask.encode(np.asfortranarray(mask, dtype=np.uint8)))

    @classmethod
    def union(
        cls, polygons: Sequence[NDArray[np.float64]], size: tuple[int, int]
    ) -> "CompressedMask":
        """The union of one or more polygons x, y, x, y, ... in an image of `size` (H, W)."""
        return cls._of_coco(coco_mask.merge(coco_mask.frPyObjects(list(polygons), *size)))

    @classmethod
    def _of_coco(cls, encoded: dict[str, Any]) -> "CompressedMask":
        """From pycocotools, which writes the counts as bytes; JSON needs text."""
        height, width = encoded["size"]
        return cls((height, width), encoded["counts"].decode())

    def pixels(self) -> NDArray[np.uint8]:
        """The mask (H, W), 1 inside. Raises ValueError if the counts add up to more pixels."""
        return np.asarray(coco_mask.decode(vars(self)), dtype=np.uint8)

    @property
    def area(self) -> int:
        """The number of pixels inside."""
        return int(coco_mask.area(vars(self)))

    @property
    def extent(self) -> list[float]:
        """x, y, width and height px of the pixels inside."""
        return list(map(float, coco_mask.toBbox(vars(self))))

    def is_valid(self) -> bool:
        """Whether the counts are well-formed and add up to the pixels."""
        if not _NUMBERS.fullmatch(self.counts):
            return False
        try:
            # If they add up to fewer pixels, the rest is undefined: it gives other counts.
            return CompressedMask.of(self.pixels()) == self
        except ValueError:
            return False
