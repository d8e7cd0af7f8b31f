"""The settings of a training, and the fingerprint that identifies it."""

import hashlib
import json
import re
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

from shaftpose.network.building import NetworkSettings
from shaftpose.settings.parsing import as_plain
from shaftpose.settings.schema import (
    CameraSettings,
    DetectionSettings,
    LossSettings,
    PoseRanges,
    Size,
    TrainerSettings,
    TrainingSettings,
    Variant,
)
from shaftpose.settings.tree import Settings
from shaftpose.source_code import source_files
from shaftpose.stage_files import DataFacts
from shaftpose.training.precision import native_precision

# Settings of a training that may change before it resumes, and the names of a variant.
_FREE = {"loader_workers", "checkpoint_minutes", "max_hours"}
_CALLED = {"name", "title"}
_PACKAGES = ("torch", "lightning", "numpy", "opencv-python-headless")


@dataclass(frozen=True)
class Recipe:
    """All settings that determine a training, and `detection` for its validation."""

    seed: int
    variant: Variant
    size: Size
    camera: CameraSettings
    poses: PoseRanges
    loss: LossSettings
    training: TrainingSettings
    trainer: TrainerSettings
    detection: DetectionSettings

    def resolved(self) -> "Recipe":
        """The recipe with the device's precision instead of `auto`, and, for a detector, with its
        own number of steps and no L_pose."""
        size, loss = self.size, self.loss
        if size.precision == "auto":
            size = replace(size, precision=native_precision(self.trainer.accelerator))
        if not self.variant.pose_loss:
            size = replace(size, steps=size.detector_steps)
            loss = replace(loss, beta=(0.0,) * len(loss.beta))
        return replace(self, size=size, loss=loss)

    def network(self) -> NetworkSettings:
        """The network's part of the settings."""
        return NetworkSettings(self.variant, self.size, self.camera, self.poses, self.loss)

    def common(self) -> dict[str, Any]:
        """The settings in which compared trainings must agree; variant and seed may differ.

        So may the trainer: on all of conf/trainer a step has the same images and batch statistics.
        """
        training = {k: v for k, v in as_plain(self.training).items() if k not in _FREE}
        parts = {"size": self.size, "camera": self.camera, "poses": self.poses, "loss": self.loss}
        return {name: as_plain(part) for name, part in parts.items()} | {"training": training}

    def of_variant(self) -> dict[str, Any]:
        """The settings in which trainings of one variant must agree: all except its names.

        Each may start from a detector of its own seed, as long as all start from a detector.
        """
        settings = {k: v for k, v in as_plain(self.variant).items() if k not in _CALLED}
        return settings | {"start": self.variant.start is not None}

    def everything(self) -> dict[str, Any]:
        """All settings that determine a training."""
        variant = {"name": self.variant.name, **self.of_variant()}
        trainer = asdict(self.trainer)
        return self.common() | {"variant": variant, "seed": self.seed, "trainer": trainer}


def training_recipe(settings: Settings) -> Recipe:
    """The recipe of the training that the settings describe."""
    return Recipe(
        seed=settings.seed,
        variant=settings.variant,
        size=settings.size,
        camera=settings.rendering.camera,
        poses=settings.rendering.poses,
        loss=settings.loss,
        training=settings.training,
        trainer=settings.trainer,
        detection=settings.detection,
    )


def fingerprint(recipe: Recipe, data: DataFacts) -> str:
    """Hexadecimal digest of all that determines a training: settings, code, packages and data."""
    described = [recipe.everything(), asdict(data)]
    digest = hashlib.sha256(json.dumps(described, sort_keys=True).encode())
    for package in _PACKAGES:
        digest.update(f"{package} {version(package)}".encode())
    for path in code_files(recipe):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def code_files(recipe: Recipe) -> list[Path]:
    """The source files that compute a training, without the networks of other variants."""
    described = json.dumps(recipe.variant.network)
    networks = [
        name.rpartition(".")[0] for name in re.findall(r'"_target_": "([\w.]+)"', described)
    ]
    return source_files(["shaftpose.training.run", *networks])
