"""Training, validation and test split of the rendered images, and its lists."""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.errors import InputError
from shaftpose.core.files import write_csv
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

    `settings.test` is the test part's share of the images, `settings.validation` the validation
    part's share of the rest. Method "grouped" puts no source into two parts, and leaves images out
    if there are few sources; "random" is the paper's plain split. Raises InputError if a part would
    be empty.
    """
    # In a random split, every image is a group of its own.
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
    """Keys of randomly chosen whole groups with `count` images, or as few more as possible."""
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
    """Indices of sizes that add up to `target`, or None: the subset sum problem."""
    # Bit s of entry n: whether some of the first n sizes add up to s.
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
    """The keys of one part. Raises InputError naming the file if it is missing or empty."""
    path = folder / f"{part}.csv"
    if not path.is_file():
        raise InputError(f"{path}: no such list; run `dvc repro split`")
    with path.open(newline="") as stream:
        keys = [row["key"] for row in csv.DictReader(stream)]
    if not keys:
        raise InputError(f"{path}: lists no image; run `dvc repro split`")
    return keys


def first_images(images: Path, lists: Path, part: str, count: int) -> NDArray[np.uint8]:
    """The first images (N, S, S, 3) of one part, from the shards in `images`."""
    shards = ShardedDataset(images)
    return np.stack([shards.rgb(key) for key in read_keys(lists, part)[:count]])
