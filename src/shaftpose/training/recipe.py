"""The settings of a training."""

from collections.abc import Set
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import torch

from shaftpose.core.instruments import POSE_DIMENSIONS
from shaftpose.settings.parsing import as_plain
from shaftpose.settings.schema import (
    CameraSettings,
    DetectionSettings,
    LossSettings,
    PoseRanges,
    RunSize,
    TrainerSettings,
    TrainingSettings,
    Variant,
)
from shaftpose.settings.tree import Settings, check_image_size

# Settings of a training that may change before it resumes.
_FREE = {"loader_workers", "images_in_memory", "checkpoint_minutes", "max_hours"}
# Settings that leave no trace while they are off, so that older trainings stay comparable.
_OPTIONS = {"keep_best", "patience"}
# Sizes that a training reads only as images, as the weights that it starts from, or in the
# variant's file.
_SIZES_ELSEWHERE = {
    "sources", "variations", "images", "images_per_shard", "samples", "test_set",
    "stand_in_images", "detector_steps", "width", "depth", "symmetries",
}  # fmt: skip
# The CPU instructions that make bfloat16 faster. avx512_bf16 alone does not: a training step took
# 1.4 times as long as in single precision.
_CPU_BFLOAT16 = "amx_bf16"


@dataclass(frozen=True)
class Recipe:
    """The settings of a training.

    `variant` already holds the settings that its network and loss read. `poses` and `loss` are here
    only to compare trainings, `detection` only for validation.
    """

    seed: int
    variant: Variant
    size: RunSize
    camera: CameraSettings
    poses: PoseRanges
    loss: LossSettings
    training: TrainingSettings
    trainer: TrainerSettings
    detection: DetectionSettings

    def resolved(self) -> "Recipe":
        """The recipe with the device's precision instead of `auto`, and, for a detector, with its
        own number of steps."""
        size = self.size
        if size.precision == "auto":
            size = replace(size, precision=native_precision(self.trainer.accelerator))
        if not self.variant.pose_loss:
            size = replace(size, steps=size.detector_steps)
        return replace(self, size=size)

    def comparison_key(self) -> dict[str, Any]:
        """The settings in which compared trainings must agree; variant and seed may differ.

        So may the trainer: on all of conf/trainer a step has the same images and batch statistics.
        """
        parts = {"size": self.size, "camera": self.camera, "poses": self.poses, "loss": self.loss}
        return {name: as_plain(part) for name, part in parts.items()} | {"training": self._training}

    @property
    def _training(self) -> dict[str, Any]:
        """The settings of the training that determine its result."""
        known = without(_FREE, self.training)
        return {name: one for name, one in known.items() if one or name not in _OPTIONS}

    def variant_key(self) -> dict[str, Any]:
        """The settings in which trainings of one variant must agree: all except its names.

        Each may start from a detector of its own seed, as long as all start from a detector.
        """
        start = self.variant.start is not None
        return without({"name", "title"}, self.variant) | {"start": start}

    def fingerprint_fields(self) -> dict[str, Any]:
        """All settings that determine a training, given its data."""
        return {
            "variant": {"name": self.variant.name, **self.variant_key()},
            "size": without(_SIZES_ELSEWHERE, self.size),
            "training": self._training,
            "trainer": asdict(self.trainer),
            "seed": self.seed,
        }

    def parameters(self) -> dict[str, Any]:
        """The settings by which a tracked run is found; beta's parts have a name each."""
        beta = dict(zip(POSE_DIMENSIONS, self.loss.beta, strict=True))
        weights = {"alpha": self.loss.alpha, "gamma": self.loss.gamma, "beta": beta}
        named = {
            "variant": without({"title"}, self.variant),
            "loss": weights,
            "detection": as_plain(self.detection),
        }
        return self.fingerprint_fields() | self.comparison_key() | named


def without(names: Set[str], settings: object) -> dict[str, Any]:
    """A part of the settings as plain values, without some of them."""
    return {name: value for name, value in as_plain(settings).items() if name not in names}


def training_recipe(settings: Settings) -> Recipe:
    """The recipe of the training that the settings describe.

    Raises InputError if its network cannot read the camera's images.
    """
    check_image_size(settings.variant, settings.camera)
    return Recipe(
        seed=settings.seed,
        variant=settings.variant,
        size=settings.size,
        camera=settings.camera,
        poses=settings.poses,
        loss=settings.loss,
        training=settings.training,
        trainer=settings.trainer,
        detection=settings.detection,
    )


def native_precision(accelerator: str) -> Literal["32-true", "bf16-mixed"]:
    """Lightning's precision name: `bf16-mixed` if bfloat16 is faster, else `32-true`.

    accelerator: `cpu`, `gpu` or `auto`, a GPU if there is one. Only x86 CPUs can get `bf16-mixed`;
    others were not tested.
    """
    if accelerator != "cpu" and torch.cuda.is_available():
        native = torch.cuda.is_bf16_supported(including_emulation=False)
    else:
        native = torch.cpu.get_capabilities().get(_CPU_BFLOAT16, False)
    return "bf16-mixed" if native else "32-true"
