"""The small JSON files that stages pass to each other.

`training.json` holds a `TrainingRecord`, `about.json` an `AboutImages`, `evaluation.json` an
`evaluation.results.Evaluation` and `silhouette.json` an `evaluation.results.Silhouettes`. Lists of
images are CSV files (`dataset.split`), images are in shards (`core.shards`).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError

from shaftpose.core.errors import InputError
from shaftpose.core.files import read_json

T = TypeVar("T")

# Domains of the images without poses.
REAL, STAND_IN = "real", "stand-in"


@dataclass(frozen=True)
class AboutImages:
    """The images without poses; domain: `REAL`, or `STAND_IN` if they are rendered."""

    domain: str


@dataclass(frozen=True)
class MixedInImages:
    """Images without poses among the training images; domain: see `AboutImages`."""

    domain: str
    images: int
    digest: str


@dataclass(frozen=True)
class DataRecord:
    """The data of a training.

    start: digest of the checkpoint that it started from, None without one; digest: of the
    rendered images and their split; mixed_in: None for a training on rendered images alone.
    """

    start: str | None
    training_images: int
    digest: str
    mixed_in: MixedInImages | None


@dataclass(frozen=True)
class TrainingRecord:
    """A finished training.

    variant: settings that trainings of one variant share; recipe: settings that compared trainings
    share; parameters: number of weights.
    """

    training_id: str
    fingerprint: str
    seed: int
    data: DataRecord
    variant: Mapping[str, Any]
    recipe: Mapping[str, Any]
    skipped_images: int
    steps: int
    parameters: int

    @property
    def has_backbone(self) -> bool:
        """Whether the network has the paper's backbone, which width and depth scale."""
        return "backbone" in self.variant["network"]


def read_training(
    folder: Path, remedy: str = "run `make clean`, then `dvc repro -f train`"
) -> TrainingRecord:
    """Read the `training.json` next to a checkpoint. Raises as `read_stage_file` does."""
    return read_stage_file(folder / "training.json", TrainingRecord, remedy)


def read_domain(folder: Path) -> str:
    """Domain of the images without poses in a folder: `REAL` or `STAND_IN`."""
    return read_stage_file(folder / "about.json", AboutImages, "run `dvc repro real_images`").domain


def read_stage_file(path: Path, kind: type[T], remedy: str) -> T:
    """Read a JSON file as a `kind`.

    Raises InputError, naming the file, the first wrong key and the remedy, if the file is missing,
    damaged or of another version.
    """
    try:
        return TypeAdapter(kind).validate_python(read_json(path, remedy))
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(map(str, first["loc"]))
        raise InputError(
            f"{path}: of another version, or damaged ({key}: {first['msg']}); {remedy}"
        ) from error
