"""The stream of training images and its batches."""

import os
from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
import yaml

from shaftpose.core.errors import InputError
from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.core.images import write_jpeg
from shaftpose.core.instruments import UNKNOWN, Annotations
from shaftpose.core.samples import Instrument, Sample, sample_key
from shaftpose.core.shard_writer import ShardWriter
from shaftpose.core.shards import ShardedDataset
from shaftpose.dataset.batches import Batch, LabelledImage, pad_batch
from shaftpose.dataset.coco_images import CocoImage, CocoInstrument
from shaftpose.dataset.colour_transforms import UniformNoise
from shaftpose.dataset.compressed_masks import CompressedMask
from shaftpose.dataset.labelled_images import CocoImages, Images, RenderedImages
from shaftpose.dataset.training_data import TrainingData
from shaftpose.dataset.training_stream import SkippedImages, TrainingStream

SIZE = 32
BOX = [4.0, 8.0, 16.0, 24.0]
POSE = [1.0, -2.0, 20.0, 70.0, 123.0]


class Numbered(Images):
    """Image n is filled with the level `first` + n."""

    def __init__(self, first: int, count: int, has_pose: bool) -> None:
        self.first, self.count, self.has_pose = first, count, has_pose

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, index: int) -> LabelledImage:
        rgb = np.full((SIZE, SIZE, 3), self.first + index, dtype=np.uint8)
        poses = np.array([POSE]) if self.has_pose else None
        return rgb, Annotations(np.array([BOX]), poses)


RENDERED = Numbered(0, 30, has_pose=True)
REAL = Numbered(100, 7, has_pose=False)


def stream(length: int = 110, real_share: float = 2 / 11, seed: int = 5) -> TrainingStream:
    return TrainingStream(RENDERED, REAL, real_share, (), length, seed)


def levels(items: TrainingStream, numbers: Sequence[int] | None = None) -> list[int]:
    """The image number of each item."""
    return [int(items[n][0][0, 0, 0]) for n in (numbers or range(len(items)))]


def is_real(items: TrainingStream) -> list[bool]:
    return [items[n][1].poses is None for n in range(len(items))]


def test_real_and_rendered_images_are_mixed_two_to_nine() -> None:
    real = is_real(stream(110))
    # 110 * 2 / 11 = 20 real and 90 rendered, spread evenly: two in every 11.
    assert sum(real) == 20
    assert [sum(real[n : n + 11]) for n in range(0, 110, 11)] == [2] * 10


def test_the_share_of_the_configuration_is_two_to_nine_in_the_long_run() -> None:
    file = Path(__file__).parents[2] / "conf/variant/d_noise_real.yaml"
    share = yaml.safe_load(file.read_text())["real_share"]
    assert sum(is_real(stream(11_000, real_share=share))) == 2000


def test_without_a_share_or_real_images_all_are_rendered() -> None:
    assert not any(is_real(stream(60, real_share=0.0)))
    assert not any(is_real(replace(stream(60), real=None, real_share=0.0)))
    assert all(is_real(stream(20, real_share=1.0)))


def test_each_rendered_image_is_seen_once_a_turn() -> None:
    rendered = [level for level in levels(stream(110)) if level < 100]
    assert len(rendered) == 90
    turns = [rendered[n : n + 30] for n in (0, 30, 60)]
    assert all(sorted(turn) == list(range(30)) for turn in turns)
    # A new order in each turn, different from that of the files.
    assert len({tuple(turn) for turn in turns} | {tuple(range(30))}) == 4


def test_each_real_image_is_seen_once_a_turn() -> None:
    real = [level for level in levels(stream(110)) if level >= 100]
    assert sorted(real[:7]) == sorted(real[7:14]) == list(range(100, 107))
    assert real[:7] != real[7:14]


def test_the_seed_decides_the_order() -> None:
    assert levels(stream(40)) == levels(stream(40))
    assert levels(stream(40, seed=6)) != levels(stream(40))


def noisy_stream() -> TrainingStream:
    return replace(stream(110), transforms=(UniformNoise(10, probability=1.0),))


def test_item_n_does_not_depend_on_what_came_before() -> None:
    items = noisy_stream()
    forwards = [items[n][0] for n in range(110)]
    fresh = noisy_stream()
    for n in np.random.default_rng(0).permutation(110).tolist():
        np.testing.assert_array_equal(fresh[n][0], forwards[n])
    # A longer run starts with the same items.
    np.testing.assert_array_equal(replace(items, length=500)[109][0], forwards[109])


def test_each_item_has_noise_of_its_own() -> None:
    items = noisy_stream()
    plain = levels(stream(110))
    noise = [items[n][0].astype(int) - plain[n] for n in range(20) if plain[n] >= 10]
    assert all(np.any(one != noise[0]) for one in noise[1:])


def test_transforms_are_applied_in_turn() -> None:
    def add_one(rgb: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return rgb + np.uint8(1)

    def double(rgb: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return rgb * np.uint8(2)

    changed = levels(replace(stream(30), transforms=(add_one, double)))
    assert changed == [(level + 1) * 2 for level in levels(stream(30))]


def labelled(boxes: list[list[float]], with_poses: bool = True) -> LabelledImage:
    poses = np.array([POSE] * len(boxes)).reshape(-1, 5) if with_poses else None
    annotations = Annotations(np.array(boxes, dtype=float).reshape(-1, 4), poses)
    return np.full((SIZE, SIZE, 3), len(boxes), dtype=np.uint8), annotations


def test_a_batch_is_padded() -> None:
    batch = pad_batch([labelled([BOX]), labelled([BOX, [0, 0, 32, 32]], False), labelled([])])
    images, targets = batch
    assert (images.shape, images.dtype) == ((3, SIZE, SIZE, 3), torch.uint8)
    assert images[:, 0, 0, 0].tolist() == [1, 2, 0]
    # Boxes in units of the side, 32: 4, 8, 16, 24 -> 1/8, 1/4, 1/2, 3/4.
    unit, none = [0.125, 0.25, 0.5, 0.75], [0.0] * 4
    assert targets.boxes.tolist() == [[unit, none], [unit, [0, 0, 1, 1]], [none, none]]
    assert targets.boxes.dtype == torch.float32
    assert targets.poses.tolist() == [[POSE, [0] * 5], [[0] * 5] * 2, [[0] * 5] * 2]
    assert targets.valid.tolist() == [[True, False], [True, True], [False, False]]
    # An image without instruments counts as having all poses.
    assert targets.has_pose.tolist() == [True, False, True]
    assert (targets.valid.dtype, targets.has_pose.dtype) == (torch.bool, torch.bool)


def test_a_batch_without_instruments_has_one_empty_place() -> None:
    targets = pad_batch([labelled([]), labelled([])]).targets
    assert targets.boxes.shape == (2, 1, 4)
    assert targets.poses.shape == (2, 1, 5)
    assert not targets.valid.any()


def write_shard(folder: Path, count: int) -> ShardedDataset:
    """Image n is of level 10 n and has one shaft at x = n mm; image 0 has none."""
    mask = np.zeros((SIZE, SIZE), dtype=bool)
    mask[8:24, 4:16] = True
    with ShardWriter(folder / "shard-000000.tar", 95) as writer:
        for n in range(count):
            pose = ShaftPose(float(n), -2.0, 20.0, 70.0, 123.0)
            shaft = Instrument(pose, mask, mask)
            rgb = np.full((SIZE, SIZE, 3), 10 * n, dtype=np.uint8)
            camera = Camera.from_field_of_view(SIZE, SIZE, 95.0)
            writer.write(Sample(sample_key(n), rgb, (shaft,) if n else (), camera, {}))
    return ShardedDataset(folder)


def real_images(folder: Path) -> CocoImages:
    path = folder / "real.jpg"
    write_jpeg(np.full((SIZE, 48, 3), 200, dtype=np.uint8), path)
    # 48 x 32: the square starts at column 8.
    shaft = CocoInstrument((12.0, 8.0, 24.0, 24.0), None, occluded=False)
    return CocoImages([CocoImage(path, 48, SIZE, (shaft,))], SIZE)


def test_rendered_images_are_the_chosen_ones(tmp_path: Path) -> None:
    images = RenderedImages(write_shard(tmp_path, 4), [sample_key(3), sample_key(0)])
    assert len(images) == 2
    rgb, annotations = images[0]
    assert abs(int(rgb[0, 0, 0]) - 30) <= 1
    assert annotations.boxes.tolist() == [BOX]
    assert annotations.poses is not None
    assert annotations.poses.tolist() == [[3, -2, 20, 70, 123]]
    assert images[1][1].boxes.shape == (0, 4)


def test_real_images_have_boxes_and_no_poses(tmp_path: Path) -> None:
    images = real_images(tmp_path)
    rgb, annotations = images[0]
    assert (len(images), rgb.shape) == (1, (SIZE, SIZE, 3))
    assert annotations.boxes.tolist() == [BOX]
    assert annotations.poses is None


def test_batches_hold_the_annotated_tips_of_real_images(tmp_path: Path) -> None:
    real = real_images(tmp_path)
    axis = ((20.0, 9.0), (14.0, 23.0))
    shaft = replace(real.images[0].instruments[0], axis=axis)
    known = replace(real, images=[replace(real.images[0], instruments=(shaft,))])
    np.testing.assert_allclose(known[0][1].tips_px, [[12, 9]])  # the square starts at column 8
    rendered = RenderedImages(write_shard(tmp_path, 1), [sample_key(0)])
    assert pad_batch([rendered[0]]).targets.tips_px is None
    tips = pad_batch([rendered[0], known[0], real[0]]).targets.tips_px
    assert tips is not None
    np.testing.assert_allclose(tips[:, 0], [[np.nan] * 2, [12, 9], [np.nan] * 2])


def test_a_shaft_that_was_left_out_is_unknown_and_no_background(tmp_path: Path) -> None:
    real = replace(real_images(tmp_path), with_instances=True)
    axis = ((20.0, 9.0), (14.0, 23.0))
    mask = np.zeros((SIZE, 48), dtype=np.uint8)
    mask[8:24, 12:24] = 1
    shown = replace(real.images[0].instruments[0], mask=CompressedMask.of(mask), axis=axis)
    aside = np.zeros((SIZE, 48), dtype=np.uint8)
    aside[:, 39:] = 1  # one of nine columns is in the square, columns 8 to 40, less than a fifth
    left_out = replace(shown, box=(39.0, 0.0, 48.0, float(SIZE)), mask=CompressedMask.of(aside))
    image = replace(real.images[0], instruments=(shown, left_out))
    known = replace(real, images=[image])[0][1]
    assert known.instances is not None and known.tips_px is not None
    expected = mask[:, 8:40].copy()
    expected[aside[:, 8:40] > 0] = UNKNOWN
    assert len(known.boxes) == 1
    np.testing.assert_array_equal(known.instances, expected)
    assert np.isnan(known.tips_px).all()


def test_what_the_box_of_a_crowd_shows_is_unknown(tmp_path: Path) -> None:
    real = replace(real_images(tmp_path), with_instances=True)
    shown = real.images[0].instruments[0]
    crowd = replace(shown, box=(10.0, 4.0, 30.0, 12.0), mask=None)
    image = replace(real.images[0], instruments=(), crowds=(crowd,))
    known = replace(real, images=[image])[0][1]
    expected = np.zeros((SIZE, SIZE), dtype=np.uint8)
    expected[4:12, 2:22] = UNKNOWN  # the square starts at column 8
    assert known.instances is not None and len(known.boxes) == 0
    np.testing.assert_array_equal(known.instances, expected)


def test_masks_of_real_images_are_known_only_if_every_shaft_has_one(tmp_path: Path) -> None:
    boxed = replace(real_images(tmp_path), with_instances=True)
    assert boxed[0][1].instances is not None
    assert np.all(boxed[0][1].instances == UNKNOWN)
    mask = np.zeros((SIZE, 48), dtype=np.uint8)
    mask[8:24, 12:24] = 1
    image = boxed.images[0]
    shaft = replace(image.instruments[0], mask=CompressedMask.of(mask))
    masked = replace(boxed, images=[replace(image, instruments=(shaft,))])
    np.testing.assert_array_equal(masked[0][1].instances, mask[:, 8:40])


@pytest.fixture
def data(tmp_path: Path) -> TrainingData:
    shards = write_shard(tmp_path, 6)
    training = RenderedImages(shards, shards.keys[:4])
    items = TrainingStream(training, real_images(tmp_path), 0.25, (), length=8, seed=1)
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
    items = replace(stream(), real=None, real_share=0.0)
    validation = RenderedImages(None, [])  # type: ignore[arg-type]
    TrainingData(items, validation, batch_size=30, loader_workers=0)
    with pytest.raises(InputError, match="batch_size = 31 exceeds the 30 training images"):
        TrainingData(items, validation, batch_size=31, loader_workers=0)
    TrainingData(stream(), validation, batch_size=37, loader_workers=0)  # 7 real ones


def damage(folder: Path, key: str) -> Path:
    """Overwrite an image in its shard, as a failing disk would; headers stay intact."""
    location = ShardedDataset(folder)._members[key]["rgb.jpg"]
    with location.path.open("r+b") as file:
        file.seek(location.offset)
        file.write(bytes(location.size))
    return location.path


def rendered_stream(folder: Path, skipped: SkippedImages | None = None) -> TrainingStream:
    """Two passes over the images 0 to 3 of a shard in `folder`."""
    images = RenderedImages(ShardedDataset(folder), [sample_key(n) for n in range(4)])
    return TrainingStream(images, None, 0.0, (), length=8, seed=1, skipped=skipped)


def numbers(items: TrainingStream) -> list[int]:
    return [(int(items[n][0][0, 0, 0]) + 5) // 10 for n in range(len(items))]


def test_a_damaged_image_stops_the_training_and_is_named(tmp_path: Path) -> None:
    write_shard(tmp_path, 4)
    items, path = rendered_stream(tmp_path), damage(tmp_path, sample_key(2))
    with pytest.raises(InputError, match=f"{path}: image {sample_key(2)} is damaged"):
        numbers(items)


@pytest.mark.parametrize("workers", [0, 2])
def test_a_damaged_image_can_be_passed_over(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, workers: int
) -> None:
    write_shard(tmp_path, 4)
    skipped = SkippedImages(tmp_path / "skipped.txt")
    items = rendered_stream(tmp_path, skipped)
    order = numbers(replace(items, length=12))
    damage(tmp_path, sample_key(2))
    expected = [next(n for n in order[place:] if n != 2) for place in range(8)]
    data = TrainingData(items, items.rendered, batch_size=4, loader_workers=workers)  # type: ignore[arg-type]
    batches = list(data.train_dataloader())
    levels = torch.cat([batch.images[:, 0, 0, 0] for batch in batches])
    assert ((levels + 5) // 10).tolist() == expected
    (complaint,) = skipped.complaints()
    assert sample_key(2) in complaint
    if workers == 0:  # otherwise worker processes log it
        assert caplog.text.count(sample_key(2)) == 1


def test_a_shard_that_goes_away_is_named(tmp_path: Path) -> None:
    write_shard(tmp_path, 4)
    items = rendered_stream(tmp_path)
    (tmp_path / "shard-000000.tar").unlink()
    with pytest.raises(InputError, match="shard-000000.tar: cannot be read"):
        items[0]


def test_images_that_are_all_damaged_end_even_a_patient_training(tmp_path: Path) -> None:
    write_shard(tmp_path, 4)
    items = rendered_stream(tmp_path, SkippedImages(tmp_path / "skipped.txt"))
    for n in range(4):
        damage(tmp_path, sample_key(n))
    with pytest.raises(InputError, match="is damaged"):
        items[0]
    assert len(SkippedImages(tmp_path / "skipped.txt").complaints()) == 4
