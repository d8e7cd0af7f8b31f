"""The fingerprint of a training: digest of its settings, code, packages and data."""

import hashlib
import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path

from shaftpose.core.errors import InputError
from shaftpose.core.shard_index import shard_paths
from shaftpose.dataset.coco_images import CocoImage, read_pixels
from shaftpose.dataset.split import PARTS, read_keys
from shaftpose.source_code import source_files
from shaftpose.stage_files import DataRecord, MixedInImages, read_domain
from shaftpose.training.data import DataFolders
from shaftpose.training.recipe import Recipe, without

_PACKAGES = ("torch", "lightning", "numpy", "opencv-python-headless")
# Modules that a training runs, but that do not change its weights. A reader of data matters only by
# the data that it reads, whose digest counts.
READERS = (
    "shaftpose.training.fingerprint",
    "shaftpose.dataset.coco",
    "shaftpose.image_files.reading",
)
# Validation only decodes and measures, unless it chooses the weights or ends the training.
VALIDATION = (
    "shaftpose.training.validation_metrics",
    "shaftpose.network.ssd.decoding",
    "shaftpose.network.dense.decoding",
)


def fingerprint(recipe: Recipe, data: DataRecord) -> str:
    """Hexadecimal digest of all that determines a training: settings, code, packages and data."""
    settings = recipe.fingerprint_fields()
    if _validation_decides(recipe):
        settings["limits"] = without({"confidence_threshold", "refine"}, recipe.detection)
    described = json.dumps([settings, asdict(data)])
    # The variant's file has numbers as they were written: 1 and 1.0 are the same.
    same = json.loads(described, parse_int=float)
    digest = hashlib.sha256(json.dumps(same, sort_keys=True).encode())
    for package in _PACKAGES:
        digest.update(f"{package} {version(package)}".encode())
    for path in code_files(recipe):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def code_files(recipe: Recipe) -> list[Path]:
    """The source files that a variant's weights depend on; of networks, only its own."""
    described = json.dumps([recipe.variant.network, recipe.variant.loss])
    networks = [
        name.rpartition(".")[0] for name in re.findall(r'"_target_": "([\w.]+)"', described)
    ]
    unused = READERS if _validation_decides(recipe) else (*READERS, *VALIDATION)
    return source_files(["shaftpose.training.run", *networks], unused)


def _validation_decides(recipe: Recipe) -> bool:
    """Whether validation chooses the weights, or the last step."""
    return recipe.training.keep_best or recipe.training.patience is not None


def data_record(folders: DataFolders, mixed_in: bool, start: Path | None) -> DataRecord:
    """The data of a training, including images without poses if they are mixed in.

    start: checkpoint of the detector to start from. Raises InputError if it is missing.
    """
    if start is not None and not start.is_file():
        raise InputError(f"{start}: no such detector to start from; run `dvc repro detector`")
    return DataRecord(
        start=None if start is None else start_digest(start),
        training_images=len(read_keys(folders.split, "train")),
        digest=rendered_digest(folders.rendered, folders.split),
        mixed_in=_mixed_in(folders) if mixed_in else None,
    )


def start_digest(checkpoint: Path) -> str:
    """Hexadecimal digest of the checkpoint that a training starts from."""
    return _digest("", [checkpoint])


def _mixed_in(folders: DataFolders) -> MixedInImages:
    images = folders.mixed_in_images()
    return MixedInImages(read_domain(folders.mixed_in), len(images), annotated_digest(images))


def rendered_digest(shards: Path, split: Path) -> str:
    """Hexadecimal digest of the rendered images in a folder and of the lists of their split."""
    lists = [read_keys(split, part) for part in PARTS]
    return _digest(json.dumps(lists), shard_paths(shards))


def annotated_digest(images: Sequence[CocoImage]) -> str:
    """Hexadecimal digest of images and of their annotations, both as they were understood.

    A training depends on the meaning of these files, neither on their bytes nor on their readers'
    code.
    """
    understood = [asdict(image) | {"path": image.path.name} for image in images]
    digest = hashlib.sha256(json.dumps(understood).encode())
    for image in images:
        digest.update(read_pixels(image).tobytes())
    return digest.hexdigest()[:16]


def _digest(text: str, paths: Iterable[Path]) -> str:
    digest = hashlib.sha256(text.encode())
    for path in paths:
        with path.open("rb") as file:
            digest.update(path.name.encode() + hashlib.file_digest(file, "sha256").digest())
    return digest.hexdigest()[:16]
