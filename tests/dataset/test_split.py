"""Exact counts, disjoint parts, and no source shared by two parts."""

from collections import Counter
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from shaftpose.core.errors import InputError
from shaftpose.dataset.split import (
    PARTS,
    Split,
    read_keys,
    split_images,
    subset_with_sum,
    write_split,
)
from shaftpose.settings.schema import SplitSettings

GROUPED = SplitSettings(method="grouped", test=0.1, validation=0.05)
RANDOM = SplitSettings(method="random", test=0.1, validation=0.05)


def draw_sources(images: int, sources: int, seed: int = 0) -> dict[str, str]:
    """Key -> source background, drawn as the renderer draws backgrounds."""
    rng = np.random.default_rng(seed)
    return {f"{n:09d}": f"source-{rng.integers(sources):03d}" for n in range(images)}


def parts(split: Split) -> list[list[str]]:
    return [split.train, split.validation, split.test]


@pytest.mark.parametrize("settings", [GROUPED, RANDOM])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_nine_to_one_exactly_and_nothing_twice(settings: SplitSettings, seed: int) -> None:
    sources = draw_sources(1000, 80, seed)
    split = split_images(sources, settings, seed)
    assert len(split.test) == 100  # a tenth of 1000
    assert len(split.train) + len(split.validation) == 900
    keys = [key for part in parts(split) for key in part]
    assert sorted(keys) == sorted(sources)  # each key once
    # 5 % of 900 are 45; whole groups may add a few.
    assert 45 <= len(split.validation) <= 60
    assert all(part == sorted(part) for part in parts(split))


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_grouped_parts_share_no_source(seed: int) -> None:
    sources = draw_sources(1000, 80, seed)
    split = split_images(sources, GROUPED, seed)
    train, validation, test = ({sources[key] for key in part} for part in parts(split))
    assert not test & (train | validation)
    assert not train & validation


def test_random_split_mixes_sources_and_hits_the_counts() -> None:
    sources = draw_sources(1000, 80)
    split = split_images(sources, RANDOM, 3)
    assert len(split.validation) == 45
    # With 12 images per source and a tenth in test, both parts share sources.
    assert {sources[key] for key in split.test} & {sources[key] for key in split.train}


def test_random_split_draws_from_the_whole_set() -> None:
    # 1000 keys in order; the mean position of 100 random ones is 499.5 +- 28 (289 / sqrt 100).
    split = split_images(draw_sources(1000, 80), RANDOM, 4)
    assert abs(np.mean([int(key) for key in split.test]) - 499.5) < 4 * 28


@pytest.mark.parametrize("settings", [GROUPED, RANDOM])
def test_the_seed_alone_decides(settings: SplitSettings) -> None:
    sources = draw_sources(300, 60)
    first = split_images(sources, settings, 7)
    assert split_images(dict(sources), settings, 7) == first
    assert split_images(sources, settings, 8) != first


@pytest.mark.parametrize("images", [1_000, 10_000])
@pytest.mark.parametrize("count", [4, 27, 45])
def test_few_sources_leave_images_out(images: int, count: int) -> None:
    sources = draw_sources(images, count)
    split = split_images(sources, GROUPED, 0)
    assert len(split.test) == images // 10
    keys = [key for part in (*parts(split), split.left_out) for key in part]
    assert sorted(keys) == sorted(sources)  # each key once
    apart = {sources[key] for key in split.test + split.left_out}
    train, validation = ({sources[key] for key in part} for part in (split.train, split.validation))
    assert not apart & train and not apart & validation and not train & validation
    # At most the images of one source are left out.
    assert len(split.left_out) < max(Counter(sources.values()).values())


def test_too_few_sources_name_the_remedy() -> None:
    # Two sources: one for test, one for validation, none for training.
    sources = {f"{n:02d}": str(n % 2) for n in range(20)}
    with pytest.raises(InputError, match="1 of 10 images on 1 source backgrounds") as caught:
        split_images(sources, GROUPED, 0)
    assert "split.method: random" in str(caught.value)
    assert len(split_images(sources, RANDOM, 0).test) == 2


def test_too_few_images_for_a_test_part() -> None:
    # A tenth of 4 images is 0.4: none.
    with pytest.raises(InputError, match="0 of 4 images"):
        split_images(draw_sources(4, 4), RANDOM, 0)


def test_subset_with_sum_by_hand() -> None:
    chosen = subset_with_sum([5, 3, 8], 11)  # 3 + 8 only
    assert chosen is not None
    assert sorted(chosen) == [1, 2]
    assert subset_with_sum([5, 3, 8], 12) is None
    assert subset_with_sum([5, 3, 8], 0) == []
    assert subset_with_sum([], 1) is None


def test_subset_with_sum_agrees_with_trying_all() -> None:
    rng = np.random.default_rng(0)
    found = 0
    for _ in range(150):
        sizes = [int(size) for size in rng.integers(1, 15, rng.integers(1, 8))]
        target = int(rng.integers(0, 40))
        possible = any(
            sum(subset) == target
            for count in range(len(sizes) + 1)
            for subset in combinations(sizes, count)
        )
        chosen = subset_with_sum(sizes, target)
        assert (chosen is not None) == possible
        if chosen is not None:
            found += 1
            assert len(set(chosen)) == len(chosen)
            assert sum(sizes[n] for n in chosen) == target
    assert 30 < found < 120  # both outcomes occur


def test_lists_survive_writing_and_reading(tmp_path: Path) -> None:
    split = Split(train=["000000001", "000000004"], validation=["000000002"], test=["000000003"])
    write_split(split, tmp_path / "split")
    for part in PARTS:
        assert read_keys(tmp_path / "split", part) == getattr(split, part)
    assert (tmp_path / "split" / "train.csv").read_bytes() == b"key\n000000001\n000000004\n"


def test_a_missing_or_empty_list_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such list") as caught:
        read_keys(tmp_path, "train")
    assert str(caught.value).startswith(f"{tmp_path / 'train.csv'}: ")
    (tmp_path / "train.csv").write_text("key\n")
    with pytest.raises(InputError, match="lists no image"):
        read_keys(tmp_path, "train")
