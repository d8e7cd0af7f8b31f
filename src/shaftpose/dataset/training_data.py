"""What a network is trained on: rendered and real images as one stream, and its batches."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import torch
from lightning import LightningDataModule
from lightning.fabric.utilities.data import suggested_max_num_workers
from numpy.typing import NDArray
from torch.utils.data import DataLoader, Dataset, Sampler

from shaftpose.batches import Batch, Targets
from shaftpose.dataset.coco import RealImage, load_square
from shaftpose.dataset.skipped import SkippedImages
from shaftpose.dataset.symmetries import random_symmetry
from shaftpose.errors import InputError
from shaftpose.instruments import Annotations
from shaftpose.shards import ShardedDataset

Transform = Callable[[NDArray[np.uint8], np.random.Generator], NDArray[np.uint8]]
LabelledImage = tuple[NDArray[np.uint8], Annotations]  # (H, W, 3) uint8 RGB and what is in it


class Images(Dataset[LabelledImage], ABC):
    """A sequence of labelled images."""

    @abstractmethod
    def __len__(self) -> int:
        """The number of images."""


@dataclass(frozen=True)
class RenderedImages(Images):
    """Chosen images of a rendered dataset."""

    shards: ShardedDataset
    keys: Sequence[str]

    def __len__(self) -> int:
        """The number of images."""
        return len(self.keys)

    def __getitem__(self, index: int) -> LabelledImage:
        """Image `index` with boxes and poses."""
        key = self.keys[index]
        return self.shards.rgb(key), self.shards.annotations(key)


@dataclass(frozen=True)
class RealImages(Images):
    """Real images: boxes, no poses."""

    images: Sequence[RealImage]
    size_px: int

    def __len__(self) -> int:
        """The number of images."""
        return len(self.images)

    def __getitem__(self, index: int) -> LabelledImage:
        """Image `index` with boxes."""
        sample = load_square(self.images[index], self.size_px)
        return sample.rgb, Annotations(sample.boxes, None)


@dataclass(frozen=True)
class TrainingStream(Images):
    """The images of a whole training run, in order: item n depends on `(seed, n)` alone.

    Rendered images come in a new random order each time round; a share `real_share` of the items,
    evenly spread, are real images. With `symmetries` each is mirrored and turned at random. A run
    that stops at item n can go on from there.
    A damaged image stops the training, unless `skipped` is there to note it: then the next image in
    the order takes its place. Raises InputError naming the damaged image, or the last if all are.
    """

    rendered: Images
    real: Images | None
    real_share: float
    transforms: Sequence[Transform]
    length: int
    seed: int
    skipped: SkippedImages | None = None
    symmetries: bool = False

    @property
    def different_images(self) -> int:
        """The number of images that there are, repetitions not counted."""
        return len(self.rendered) + (len(self.real) if self.real is not None else 0)

    def __len__(self) -> int:
        """The number of images that the run sees, repetitions counted."""
        return self.length

    def __getitem__(self, n: int) -> LabelledImage:
        """Item n, changed by the transforms."""
        real_before = int(n * self.real_share)
        if self.real is not None and int((n + 1) * self.real_share) > real_before:
            rgb, annotations = self._draw(self.real, real_before)
        else:
            rgb, annotations = self._draw(self.rendered, n - real_before)
        rng = np.random.default_rng(np.random.SeedSequence([self.seed, n]))
        if self.symmetries:
            rgb, annotations = random_symmetry(rgb, annotations, rng)
        for transform in self.transforms:
            rgb = transform(rgb, rng)
        return rgb, annotations

    def _draw(self, images: Images, number: int) -> LabelledImage:
        """Draw `number` from shuffled images, or the first draw after it that is not damaged."""
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
    """The index of draw `number` from `count` items that are shuffled anew each time round."""
    return int(_order(seed, number // count, count)[number % count])


@lru_cache(maxsize=4)
def _order(seed: int, turn: int, count: int) -> NDArray[np.int64]:
    return np.random.default_rng(np.random.SeedSequence([seed, turn, count])).permutation(count)


def pad_batch(items: Sequence[LabelledImage]) -> Batch:
    """Stack images and pad their instruments; at least one place, so that no shape is 0."""
    places = max(1, *(len(annotations.boxes) for _, annotations in items))
    boxes = np.zeros((len(items), places, 4), dtype=np.float32)
    poses = np.zeros((len(items), places, 5), dtype=np.float32)
    valid = np.zeros((len(items), places), dtype=bool)
    for n, (rgb, annotations) in enumerate(items):
        count = len(annotations.boxes)
        boxes[n, :count] = annotations.boxes / rgb.shape[0]
        valid[n, :count] = True
        if annotations.poses is not None:
            poses[n, :count] = annotations.poses
    has_pose = torch.tensor([annotations.poses is not None for _, annotations in items])
    targets = Targets(
        torch.from_numpy(boxes), torch.from_numpy(poses), torch.from_numpy(valid), has_pose
    )
    return Batch(torch.from_numpy(np.stack([rgb for rgb, _ in items])), targets)


@dataclass(frozen=True)
class StepBatches(Sampler[range]):
    """The items of the stream in the batch of each step, or in a rank's share of it.

    Iteration begins with step `first`, reading nothing of what is before. The length counts all
    steps: Lightning adds those that a resumed training has behind it.
    """

    steps: int
    batch_size: int
    first: int = 0
    rank: int = 0
    ranks: int = 1

    def __len__(self) -> int:
        """The number of steps."""
        return self.steps

    def __iter__(self) -> Iterator[range]:
        """The numbers of the items, step by step."""
        share = self.batch_size // self.ranks
        for step in range(self.first, self.steps):
            start = step * self.batch_size + self.rank * share
            yield range(start, start + share)


_MOST_WORKERS = 8  # by default


class TrainingData(LightningDataModule):
    """Feeds a training run: its stream in order, and the validation images.

    The trainer says where in the stream to begin and which rank this is: each rank gets its part of
    every batch, and all validation images. Raises InputError if a batch is larger than the training
    set or cannot be shared out.

    loader_workers: processes that read, decode and augment for a rank; None: one where a CPU
    trains, which has no cores to spare, and up to 8 on cores that are free where a GPU does.
    """

    def __init__(
        self,
        stream: TrainingStream,
        validation: RenderedImages,
        batch_size: int,
        loader_workers: int | None,
    ) -> None:
        super().__init__()
        if batch_size > stream.different_images:
            raise InputError(
                f"batch_size = {batch_size} exceeds the {stream.different_images} training images; "
                "lower it in conf/profiles.yaml or render more images"
            )
        self._stream, self._validation = stream, validation
        self._batch_size, self._workers = batch_size, loader_workers

    def train_dataloader(self) -> DataLoader[LabelledImage]:
        """Batches of the stream from the trainer's step on; the stream shuffles by itself."""
        return self._loader(self._stream, batch_sampler=self._batches())

    def _batches(self) -> StepBatches:
        steps, trainer = len(self._stream) // self._batch_size, self.trainer
        if trainer is None:
            return StepBatches(steps, self._batch_size)
        if self._batch_size % trainer.world_size:
            raise InputError(
                f"batch_size = {self._batch_size} cannot be shared out among "
                f"{trainer.world_size} processes; make it a multiple in conf/profiles.yaml"
            )
        return StepBatches(
            steps, self._batch_size, trainer.global_step, trainer.global_rank, trainer.world_size
        )

    def val_dataloader(self) -> DataLoader[LabelledImage]:
        """Batches of the validation images, unaltered."""
        return self._loader(self._validation, batch_size=self._batch_size)

    def _loader(self, images: Images, **batches: Any) -> DataLoader[LabelledImage]:
        workers = self._worker_count()
        return DataLoader(
            images,
            **batches,
            collate_fn=pad_batch,
            num_workers=workers,
            persistent_workers=workers > 0,
            pin_memory=self._feeds_gpu(),
            # joblib's launcher makes a way of its own the default, in which loaders do not start.
            multiprocessing_context="fork" if workers > 0 else None,
        )

    def _worker_count(self) -> int:
        if self._workers is not None:
            return self._workers
        if self.trainer is None or not self._feeds_gpu():
            return 1
        return min(_MOST_WORKERS, suggested_max_num_workers(self.trainer.num_devices))

    def _feeds_gpu(self) -> bool:
        return self.trainer is not None and self.trainer.strategy.root_device.type == "cuda"
