"""Loaders: which batches they give, and by how many processes."""

import os
from dataclasses import fields, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch

from shaftpose.core.errors import InputError
from shaftpose.dataset.batches import Batch, LabelledImage
from shaftpose.dataset.labelled_images import RenderedImages
from shaftpose.dataset.training_data import TrainingData
from shaftpose.dataset.training_stream import TrainingStream
from tests.dataset.small_images import SIZE, coco_images, stream, write_shard


@pytest.fixture
def data(tmp_path: Path) -> TrainingData:
    shards = write_shard(tmp_path, 6)
    training = RenderedImages(shards, shards.keys[:4])
    items = TrainingStream(training, coco_images(tmp_path), 0.25, (), length=8, seed=1)
    validation = RenderedImages(shards, shards.keys[4:])
    return TrainingData(items, validation, batch_size=4, loader_workers=0)


def test_training_batches_come_in_the_order_of_the_stream(data: TrainingData) -> None:
    batches = list(data.train_dataloader())
    assert len(batches) == 2
    for batch in batches:
        assert isinstance(batch, Batch)
        assert (batch.images.shape, batch.images.dtype) == ((4, SIZE, SIZE, 3), torch.uint8)
        # A quarter of the items is real: every fourth one.
        assert batch.targets.has_pose.tolist() == [True, True, True, False]
    # Items 0, 1, 2, 4 are the first turn of the rendered images: x = n mm, or none in image 0.
    rendered = [(int(image[0, 0, 0]) + 5) // 10 for batch in batches for image in batch.images[:3]]
    assert sorted(rendered[:4]) == [0, 1, 2, 3]
    again = list(data.train_dataloader())
    assert all(torch.equal(a.images, b.images) for a, b in zip(batches, again, strict=True))


def test_validation_batches_are_the_images_in_order(data: TrainingData) -> None:
    (batch,) = data.val_dataloader()
    assert batch.targets.poses[:, 0, 0].tolist() == [4, 5]
    assert batch.targets.has_pose.all()
    assert batch.targets.boxes[0, 0].tolist() == [0.125, 0.25, 0.5, 0.75]


def first_numbers(data: TrainingData, trainer: Any) -> list[list[int]]:
    """The item numbers of each batch that a rank would read."""
    data.trainer = trainer
    batches = data.train_dataloader().batch_sampler
    assert len(batches) == 2  # all steps, whatever the first one
    return [list(numbers) for numbers in batches]


def trainer_at(step: int = 0, rank: int = 0, ranks: int = 1, device: str = "cpu") -> Any:
    strategy = SimpleNamespace(root_device=torch.device(device))
    return SimpleNamespace(
        global_step=step, global_rank=rank, world_size=ranks, num_devices=ranks, strategy=strategy
    )


def test_training_begins_at_the_trainers_step(data: TrainingData) -> None:
    assert first_numbers(data, trainer_at()) == [[0, 1, 2, 3], [4, 5, 6, 7]]
    assert first_numbers(data, trainer_at(step=1)) == [[4, 5, 6, 7]]


def test_what_was_trained_on_before_is_not_read_again(data: TrainingData, tmp_path: Path) -> None:
    _, expected = data.train_dataloader()
    read: list[int] = []

    class Recorded(TrainingStream):
        def __getitem__(self, n: int) -> LabelledImage:
            read.append(n)
            return super().__getitem__(n)

    items = data._stream
    data._stream = Recorded(**{field.name: getattr(items, field.name) for field in fields(items)})
    data.trainer = trainer_at(step=1)
    (batch,) = data.train_dataloader()
    assert read == [4, 5, 6, 7]
    assert torch.equal(batch.images, expected.images)


def test_ranks_share_every_batch(data: TrainingData) -> None:
    assert first_numbers(data, trainer_at(rank=0, ranks=2)) == [[0, 1], [4, 5]]
    assert first_numbers(data, trainer_at(rank=1, ranks=2)) == [[2, 3], [6, 7]]


@pytest.mark.parametrize(
    ("device", "ranks", "cores", "workers"),
    [
        ("cpu", 1, 32, 1),
        ("cuda", 1, 6, 5),
        ("cuda", 2, 12, 5),
        ("cuda", 1, 32, 8),
        ("cuda", 1, 1, 1),
    ],
)
def test_a_gpu_is_fed_by_the_cores_that_are_free(
    data: TrainingData,
    monkeypatch: pytest.MonkeyPatch,
    device: str,
    ranks: int,
    cores: int,
    workers: int,
) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: set(range(cores)))
    data._workers = None
    data.trainer = trainer_at(ranks=ranks, device=device)
    for loader in (data.train_dataloader(), data.val_dataloader()):
        assert loader.num_workers == workers
        assert loader.pin_memory == (device == "cuda")
    data._workers = 3
    assert data.train_dataloader().num_workers == 3


def test_a_batch_that_cannot_be_shared_is_refused(data: TrainingData) -> None:
    data.trainer = trainer_at(ranks=3)
    with pytest.raises(InputError, match="batch_size = 4 .* among 3 processes"):
        data.train_dataloader()


def test_a_batch_larger_than_the_training_set_is_refused() -> None:
    items = replace(stream(), mixed_in=None, mixed_in_share=0.0)
    validation = RenderedImages(None, [])  # type: ignore[arg-type]
    TrainingData(items, validation, batch_size=30, loader_workers=0)
    with pytest.raises(InputError, match="batch_size = 31 exceeds the 30 training images"):
        TrainingData(items, validation, batch_size=31, loader_workers=0)
    TrainingData(stream(), validation, batch_size=37, loader_workers=0)  # 7 real ones
