"""Image lists of the training, validation and test splits."""

import csv
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.errors import InputError
from shaftpose.core.shards import ShardedDataset

PARTS = ("train", "validation", "test")


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


def first_images(images: Path, lists: Path, part: str, count: int) -> NDArray[np.uint8]:
    """The first images (N, 299, 299, 3) uint8 of one split."""
    shards = ShardedDataset(images)
    return np.stack([shards.rgb(key) for key in read_keys(lists, part)[:count]])
