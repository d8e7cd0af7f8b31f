"""Loaders of the training batches and of the validation images."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from lightning import LightningDataModule
from lightning.fabric.utilities.data import suggested_max_num_workers
from torch.utils.data import DataLoader, Sampler

from shaftpose.core.errors import InputError
from shaftpose.dataset.batches import LabelledImage, pad_batch
from shaftpose.dataset.labelled_images import Images, RenderedImages
from shaftpose.dataset.training_stream import TrainingStream


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
