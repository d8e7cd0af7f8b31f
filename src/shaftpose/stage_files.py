"""What stages hand to each other in small JSON files.

`training.json` is a `TrainingFacts`, `about.json` an `AboutReal`, `evaluation.json` an
`evaluation.results.Evaluation`, and `silhouette.json` holds the `SilhouetteScore` of each set of
images. Lists of images are CSV files (`dataset.split`), images shards (`core.shards`).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError

from shaftpose.core.errors import InputError
from shaftpose.core.files import read_json

T = TypeVar("T")

FITTED = "fitted/"  # begins the names of metrics and image sets of fitted poses


@dataclass(frozen=True)
class AboutReal:
    """`about.json` of the real images; domain: "real", or "stand-in" if they are rendered."""

    domain: str


@dataclass(frozen=True)
class RealFacts:
    """The real training images; domain: see `AboutReal`."""

    domain: str
    images: int
    digest: str


@dataclass(frozen=True)
class DataFacts:
    """The data of a training.

    start: digest of the detector that it started from; digest: of the rendered images and their
    split; real: None unless real images were mixed in.
    """

    start: str | None
    training_images: int
    digest: str
    real: RealFacts | None


@dataclass(frozen=True)
class TrainingFacts:
    """A finished training, as `training.json` describes it.

    variant, recipe: the settings in which trainings of one variant, and compared trainings, must
    agree (`Recipe.variant_key`, `Recipe.comparison_key`); parameters: number of weights.
    """

    training_id: str
    fingerprint: str
    seed: int
    data: DataFacts
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
) -> TrainingFacts:
    """Read the `training.json` next to a checkpoint. Raises as `read_stage_file` does."""
    return read_stage_file(folder / "training.json", TrainingFacts, remedy)


def read_domain() -> str:
    """Domain of the real images: "real" or "stand-in"."""
    path, remedy = Path("data/real/about.json"), "run `dvc repro real_images`"
    return read_stage_file(path, AboutReal, remedy).domain


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
