"""Training data: rendered and real images as one stream, and its batches."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
import torch
from lightning import LightningDataModule
from lightning.fabric.utilities.data import suggested_max_num_workers
from numpy.typing import NDArray
from torch.utils.data import DataLoader, Dataset, Sampler

from shaftpose.core.errors import InputError
from shaftpose.core.instruments import UNKNOWN, Annotations
from shaftpose.core.shards import ShardedDataset
from shaftpose.dataset.batches import Batch, Targets
from shaftpose.dataset.real_images import RealImage, load_square
from shaftpose.dataset.similarities import random_similarity
from shaftpose.dataset.skipped import SkippedImages
from shaftpose.dataset.symmetries import random_symmetry

Transform = Callable[[NDArray[np.uint8], np.random.Generator], NDArray[np.uint8]]
LabelledImage = tuple[NDArray[np.uint8], Annotations]  # (H, W, 3) uint8 RGB and its annotations


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
class RealImages(Images):
    """Real images, with boxes but without poses, optionally with each pixel's instrument number."""

    images: Sequence[RealImage]
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


@dataclass(frozen=True)
class TrainingStream(Images):
    """The images of a whole training run, in order: item n depends on `(seed, n)` alone.

    Rendered images are reshuffled in each pass; a share `real_share` of the items, evenly spread,
    are real images. With `symmetries`, each image is randomly mirrored and turned, and scaled as
    well if its poses are unknown. A run that stops at item n can resume there.
    If `skipped` is given, it records damaged images and the next image replaces each of them.
    Raises InputError naming the damaged image otherwise, or the last one if all are damaged.
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
        """The number of images, not counting repetitions."""
        return len(self.rendered) + (len(self.real) if self.real is not None else 0)

    def __len__(self) -> int:
        """The number of images in the run, counting repetitions."""
        return self.length

    def __getitem__(self, n: int) -> LabelledImage:
        """Item n, after the transforms."""
        real_before = int(n * self.real_share)
        if self.real is not None and int((n + 1) * self.real_share) > real_before:
            rgb, annotations = self._draw(self.real, real_before)
        else:
            rgb, annotations = self._draw(self.rendered, n - real_before)
        rng = np.random.default_rng(np.random.SeedSequence([self.seed, n]))
        if self.symmetries:
            rgb, annotations = random_symmetry(rgb, annotations, rng)
            rgb, annotations = random_similarity(rgb, annotations, rng)
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
    return np.random.default_rng(np.random.SeedSequence([seed, turn, count])).permutation(count)


def pad_batch(items: Sequence[LabelledImage]) -> Batch:
    """Stack images and pad their instruments, to at least one so that no dimension is 0."""
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
        torch.from_numpy(boxes),
        torch.from_numpy(poses),
        torch.from_numpy(valid),
        has_pose,
        _stacked_instances(items),
        _padded_tips(items, places),
    )
    return Batch(torch.from_numpy(np.stack([rgb for rgb, _ in items])), targets)


def _stacked_instances(items: Sequence[LabelledImage]) -> torch.Tensor | None:
    """Instrument maps (B, H, W) uint8, `UNKNOWN` for images without one; None if all lack it."""
    if all(known.instances is None for _, known in items):
        return None
    unknown = np.full(items[0][0].shape[:2], UNKNOWN, dtype=np.uint8)
    found = [unknown if known.instances is None else known.instances for _, known in items]
    return torch.from_numpy(np.stack(found))


def _padded_tips(items: Sequence[LabelledImage], places: int) -> torch.Tensor | None:
    """Tips (B, G, 2) px of images without poses; None if no image has any."""
    if all(known.tips_px is None for _, known in items):
        return None
    tips = np.full((len(items), places, 2), np.nan, dtype=np.float32)
    for n, (_, known) in enumerate(items):
        if known.tips_px is not None:
            tips[n, : len(known.tips_px)] = known.tips_px
    return torch.from_numpy(tips)


@dataclass(frozen=True)
class StepBatches(Sampler[range]):
    """The stream items of each step's batch, or of a rank's share of it.

    Iteration begins at step `first` and reads no earlier item. The length counts all steps, because
    Lightning also counts the finished steps of a resumed training.
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
        """The item numbers of each step."""
        share = self.batch_size // self.ranks
        for step in range(self.first, self.steps):
            start = step * self.batch_size + self.rank * share
            yield range(start, start + share)


_MOST_WORKERS = 8  # by default


class TrainingData(LightningDataModule):
    """Data of a training run: its stream in order, and the validation images.

    The trainer sets the first step and the rank: each rank gets its share of every batch and all
    validation images. Raises InputError if a batch is larger than the training set or cannot be
    divided among the ranks.

    loader_workers: processes of a rank that read, decode and augment; None: one for training on a
    CPU, which has no spare cores, and up to 8 on free cores for training on a GPU.
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
        """Batches of the stream from the trainer's current step; the stream itself shuffles."""
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
            # joblib's launcher sets a default start method with which loaders do not start.
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
