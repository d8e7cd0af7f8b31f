"""Split of the rendered images into training, validation and test part, and its lists."""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from shaftpose.core.errors import InputError
from shaftpose.core.files import write_csv
from shaftpose.core.images import Image
from shaftpose.core.shards import ShardedDataset
from shaftpose.settings.schema import SplitSettings

PARTS = ("train", "validation", "test")


@dataclass(frozen=True)
class Split:
    """Keys of the images of each part; no key is in two of them.

    left_out: surplus images of the test part's backgrounds; they are in no part.
    """

    train: list[str]
    validation: list[str]
    test: list[str]
    left_out: list[str] = field(default_factory=list)


def split_images(sources: Mapping[str, str], settings: SplitSettings, seed: int) -> Split:
    """Split images, given as key -> id of the source background.

    The test part has exactly `settings.test` of the images (rounded); the validation part is cut
    from the rest. "grouped": no source is in two parts, which with few sources leaves images out;
    "random": the paper's plain split. Raises InputError if a part would be empty.
    """
    # Random: every image is a group of its own.
    groups = sources if settings.method == "grouped" else {key: key for key in sources}
    rng = np.random.default_rng(seed)
    test_count = round(settings.test * len(sources))
    taken = _take_groups(groups, list(sources), test_count, rng)
    test = sorted(taken)
    rest = [key for key in sources if key not in taken]
    validation_count = max(1, round(settings.validation * len(rest)))
    validation = _take_groups(groups, rest, validation_count, rng)
    return Split(
        train=[key for key in rest if key not in validation],
        validation=sorted(validation),
        test=test[:test_count],
        left_out=test[test_count:],
    )


def _take_groups(
    groups: Mapping[str, str],
    keys: Sequence[str],
    count: int,
    rng: np.random.Generator,
) -> set[str]:
    """Keys of some whole groups that hold `count` images, or the smallest number above it."""
    members: dict[str, list[str]] = {}
    for key in keys:
        members.setdefault(groups[key], []).append(key)
    names = [str(name) for name in rng.permutation(sorted(members))]
    sizes = [len(members[name]) for name in names]
    for target in range(count, len(keys) if count else 0):
        chosen = subset_with_sum(sizes, target)
        if chosen is not None:
            return {key for n in chosen for key in members[names[n]]}
    raise InputError(
        f"params.yaml: split: {count} of {len(keys)} images on {len(names)} source backgrounds "
        "cannot be set apart; render more images, give more backgrounds, or choose "
        "split.method: random"
    )


def subset_with_sum(sizes: Sequence[int], target: int) -> list[int] | None:
    """Indices of sizes that add up to `target`, or None (subset sum; a bit set per prefix)."""
    reachable = [1]
    for size in sizes:
        reachable.append((reachable[-1] | reachable[-1] << size) & ((1 << target + 1) - 1))
    if not reachable[-1] >> target & 1:
        return None
    chosen = []
    for n in reversed(range(len(sizes))):
        # Skip this size if the others reach the sum.
        if not reachable[n] >> target & 1:
            chosen.append(n)
            target -= sizes[n]
    return chosen


def write_split(split: Split, folder: Path) -> None:
    """Write one CSV file of keys for each part."""
    for part in PARTS:
        write_csv(folder / f"{part}.csv", ["key"], [[key] for key in getattr(split, part)])


def read_keys(folder: Path, part: str) -> list[str]:
    """The keys of one split. Raises InputError naming the file if it is missing or empty."""
    path = folder / f"{part}.csv"
    if not path.is_file():
        raise InputError(f"{path}: no such list; run `dvc repro split`")
    with path.open(newline="") as stream:
        keys = [row["key"] for row in csv.DictReader(stream)]
    if not keys:
        raise InputError(f"{path}: lists no image; run `dvc repro split`")
    return keys


def first_images(images: Path, lists: Path, part: str, count: int) -> Image:
    """The first images (N, 299, 299, 3) uint8 of one split."""
    shards = ShardedDataset(images)
    return np.stack([shards.rgb(key) for key in read_keys(lists, part)[:count]])
