"""The images of a training run in order, mixed, shuffled and augmented."""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.errors import InputError
from shaftpose.core.images import Image
from shaftpose.core.symmetries import random_symmetry
from shaftpose.dataset.batches import LabelledImage
from shaftpose.dataset.labelled_images import Images
from shaftpose.dataset.random_views import random_view

log = logging.getLogger(__name__)

Transform = Callable[[Image, np.random.Generator], Image]


@dataclass(frozen=True)
class SkippedImages:
    """The file in which a training records the damaged images that it skips, one in a line.

    The loader processes of all ranks add to it, and so does a resumed training.
    """

    path: Path

    def add(self, complaint: str) -> None:
        """Record and log an image, unless it is already recorded."""
        if complaint not in self.complaints():
            log.warning("skipped a damaged image: %s", complaint)
            with self.path.open("a") as file:
                file.write(f"{complaint}\n")

    def complaints(self) -> set[str]:
        """The recorded lines."""
        return set(self.path.read_text().splitlines()) if self.path.is_file() else set()


@dataclass(frozen=True)
class TrainingStream(Images):
    """The images of a whole training run, in order: item n depends on `(seed, n)` alone.

    A run that stops at item n can therefore resume there. Images are reshuffled in each pass.

    mixed_in: images without poses, a share `mixed_in_share` of the items, evenly spread.
    length: number of items.
    skipped: records each damaged image, which the next one replaces. None: a damaged image raises
    an InputError that names it. It is also raised if all images are damaged.
    symmetries: whether images are randomly mirrored and turned by quarters.
    view_px: side of random views of the images, see `random_views`; None: images as they are.
    """

    rendered: Images
    mixed_in: Images | None
    mixed_in_share: float
    transforms: Sequence[Transform]
    length: int
    seed: int
    skipped: SkippedImages | None = None
    symmetries: bool = False
    view_px: int | None = None

    @property
    def different_images(self) -> int:
        """The number of images, not counting repetitions."""
        return len(self.rendered) + (0 if self.mixed_in is None else len(self.mixed_in))

    def __len__(self) -> int:
        """The number of images in the run, counting repetitions."""
        return self.length

    def __getitem__(self, n: int) -> LabelledImage:
        """Item n, augmented."""
        mixed_in_before = int(n * self.mixed_in_share)
        if self.mixed_in is not None and int((n + 1) * self.mixed_in_share) > mixed_in_before:
            rgb, annotations = self._draw(self.mixed_in, mixed_in_before)
        else:
            rgb, annotations = self._draw(self.rendered, n - mixed_in_before)
        rng = np.random.default_rng(np.random.SeedSequence([self.seed, n]))
        if self.symmetries:
            rgb, annotations = random_symmetry(rgb, annotations, rng)
        if self.view_px is not None:
            rgb, annotations = random_view(rgb, annotations, self.view_px, rng)
        for transform in self.transforms:
            rgb = transform(rgb, rng)
        return rgb, annotations

    def _draw(self, images: Images, number: int) -> LabelledImage:
        """The shuffled image at draw `number`, or the next one that is not damaged."""
        for draw in range(number, number + len(images)):
            try:
                return images[_shuffled(self.seed, draw, len(images))]
            except InputError as error:
                if self.skipped is None:
                    raise
                self.skipped.add(str(error))
                last = error
        raise last


def _shuffled(seed: int, number: int, count: int) -> int:
    """The index of draw `number` from `count` items that are reshuffled in each pass."""
    return int(_order(seed, number // count, count)[number % count])


@lru_cache(maxsize=4)
def _order(seed: int, turn: int, count: int) -> NDArray[np.int64]:
    """The order of `count` items in pass `turn`."""
    return np.random.default_rng(np.random.SeedSequence([seed, turn, count])).permutation(count)
