"""Description of a training's data, and digests of their bytes that identify them."""

import hashlib
import json
from collections.abc import Iterable
from pathlib import Path

from shaftpose.core.errors import InputError
from shaftpose.core.shards import shard_paths
from shaftpose.dataset.coco import read_coco
from shaftpose.dataset.split import PARTS, read_keys
from shaftpose.stage_files import DataRecord, MixedInImages, read_domain


def about_data(with_real: bool, start: Path | None) -> DataRecord:
    """The data of a training, including the real, or stand-in, images if they are mixed in.

    start: checkpoint of the detector to start from. Raises InputError if it is missing.
    """
    if start is not None and not start.is_file():
        raise InputError(f"{start}: no such detector to start from; run `dvc repro detector`")
    return DataRecord(
        start=None if start is None else _digest("", [start]),
        training_images=len(read_keys(Path("data/split"), "train")),
        digest=rendered_digest(),
        mixed_in=_mixed_in() if with_real else None,
    )


def _mixed_in() -> MixedInImages:
    images = read_coco(Path("data/real/train.json"))
    return MixedInImages(read_domain(Path("data/real")), len(images), real_digest())


def rendered_digest() -> str:
    """Hexadecimal digest of the rendered images and of the lists of the split."""
    lists = [read_keys(Path("data/split"), part) for part in PARTS]
    return _digest(json.dumps(lists), shard_paths(Path("data/render/images")))


def real_digest() -> str:
    """Hexadecimal digest of the real, or stand-in, training images and their annotations."""
    annotations = Path("data/real/train.json")
    return _digest("", [annotations, *(image.path for image in read_coco(annotations))])


def _digest(text: str, paths: Iterable[Path]) -> str:
    digest = hashlib.sha256(text.encode())
    for path in paths:
        with path.open("rb") as file:
            digest.update(path.name.encode() + hashlib.file_digest(file, "sha256").digest())
    return digest.hexdigest()[:16]
