"""The order, the mixture and the changes of training images."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml

from shaftpose.core.errors import InputError
from shaftpose.core.samples import sample_key
from shaftpose.core.shards import ShardedDataset
from shaftpose.dataset.colour_transforms import UniformNoise
from shaftpose.dataset.labelled_images import RenderedImages
from shaftpose.dataset.training_data import TrainingData
from shaftpose.dataset.training_stream import SkippedImages, TrainingStream
from tests.dataset.small_images import stream, write_shard


def levels(items: TrainingStream, numbers: Sequence[int] | None = None) -> list[int]:
    """The image number of each item."""
    return [int(items[n][0][0, 0, 0]) for n in (numbers or range(len(items)))]


def is_mixed_in(items: TrainingStream) -> list[bool]:
    return [items[n][1].poses is None for n in range(len(items))]


def test_images_without_poses_are_mixed_in_two_to_nine() -> None:
    real = is_mixed_in(stream(110))
    # 110 * 2 / 11 = 20 real and 90 rendered, spread evenly: two in every 11.
    assert sum(real) == 20
    assert [sum(real[n : n + 11]) for n in range(0, 110, 11)] == [2] * 10


def test_the_share_of_the_configuration_is_two_to_nine_in_the_long_run() -> None:
    file = Path(__file__).parents[2] / "conf/variant/d_noise_real.yaml"
    share = yaml.safe_load(file.read_text())["real_share"]
    assert sum(is_mixed_in(stream(11_000, share=share))) == 2000


def test_without_a_share_or_images_to_mix_in_all_are_rendered() -> None:
    assert not any(is_mixed_in(stream(60, share=0.0)))
    assert not any(is_mixed_in(replace(stream(60), mixed_in=None, mixed_in_share=0.0)))
    assert all(is_mixed_in(stream(20, share=1.0)))


def test_each_rendered_image_is_seen_once_a_turn() -> None:
    rendered = [level for level in levels(stream(110)) if level < 100]
    assert len(rendered) == 90
    turns = [rendered[n : n + 30] for n in (0, 30, 60)]
    assert all(sorted(turn) == list(range(30)) for turn in turns)
    # A new order in each turn, different from that of the files.
    assert len({tuple(turn) for turn in turns} | {tuple(range(30))}) == 4


def test_each_mixed_in_image_is_seen_once_a_turn() -> None:
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
