"""The parts of the settings: small frozen dataclasses that check types and ranges."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, ConfigDict, Field
from pydantic.dataclasses import dataclass

from shaftpose.settings.choices import Refinement, Tip

_STRICT = ConfigDict(extra="forbid", allow_inf_nan=False)


def _ascending(pair: tuple[float, float]) -> tuple[float, float]:
    if pair[0] > pair[1]:
        raise ValueError(f"the lower end {pair[0]:g} is above the upper end {pair[1]:g}; swap them")
    return pair


def _spread(pair: tuple[float, float]) -> tuple[float, float]:
    if not pair[0] < pair[1]:
        raise ValueError("the upper end must be above the lower end: poses are scaled by the range")
    return pair


def _one_turn(pair: tuple[float, float]) -> tuple[float, float]:
    if pair[1] - pair[0] > 360:
        raise ValueError("must span at most 360 deg: other angles repeat the same shafts")
    return pair


Count = Annotated[int, Field(ge=0)]
PositiveInt = Annotated[int, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Positive = Annotated[float, Field(gt=0)]
Fraction = Annotated[float, Field(ge=0, le=1)]
PositiveFraction = Annotated[float, Field(gt=0, le=1)]
Share = Annotated[float, Field(gt=0, lt=1)]
Quality = Annotated[int, Field(ge=1, le=100)]
Kelvin = Annotated[float, Field(ge=3000, le=10000)]
HalfTurn = Annotated[float, Field(ge=0, le=180)]  # other angles repeat the same shafts

_Ascending, _Spread = AfterValidator(_ascending), AfterValidator(_spread)
Range = Annotated[tuple[float, float], _Ascending]
NotNegativeRange = Annotated[tuple[NotNegative, NotNegative], _Ascending]
PositiveIntRange = Annotated[tuple[PositiveInt, PositiveInt], _Ascending]
PositiveRange = Annotated[tuple[Positive, Positive], _Ascending]
UnitRange = Annotated[tuple[Fraction, Fraction], _Ascending]
SpreadRange = Annotated[tuple[float, float], _Spread]


def _names_a_class(values: dict[str, Any]) -> dict[str, Any]:
    if not isinstance(values.get("_target_"), str):
        raise ValueError("must name a class or function as _target_; copy it from another variant")
    for name in _targets(values):
        if not name.startswith(("shaftpose.", "torch.")):
            raise ValueError(
                f"_target_ {name} is outside of shaftpose, where a change of it would go unnoticed "
                "and not be trained: put a module that uses it into src/shaftpose/network"
            )
    return values


def _targets(values: Any) -> Iterator[str]:
    """The names at all depths of a description."""
    if isinstance(values, dict):
        if "_target_" in values:
            yield str(values["_target_"])
        for value in values.values():
            yield from _targets(value)


# `_target_` and arguments, of which `shaftpose.network.building` makes an object.
Component = Annotated[dict[str, Any], AfterValidator(_names_a_class)]


@dataclass(frozen=True, config=_STRICT)
class CameraSettings:
    """The endoscope: its square image and its field of view (paper, II)."""

    size_px: Annotated[int, Field(ge=32, le=4096)]
    view_deg: Annotated[float, Field(gt=0, lt=170)]


@dataclass(frozen=True, config=_STRICT)
class PoseRanges:
    """Ranges that poses are drawn from and normalised by (paper, Table of ranges)."""

    x_mm: SpreadRange
    y_mm: SpreadRange
    z_mm: Annotated[tuple[Positive, Positive], _Spread]  # in front of the camera
    pitch_deg: Annotated[tuple[HalfTurn, HalfTurn], _Spread]
    yaw_deg: Annotated[SpreadRange, AfterValidator(_one_turn)]

    @property
    def low(self) -> tuple[float, ...]:
        """(5,) lower ends in the order x_mm, y_mm, z_mm, pitch_deg, yaw_deg."""
        return tuple(pair[0] for pair in self._pairs)

    @property
    def high(self) -> tuple[float, ...]:
        """(5,) upper ends in the same order."""
        return tuple(pair[1] for pair in self._pairs)

    @property
    def symmetric(self) -> bool:
        """Whether mirrored and turned images show poses in the same ranges."""
        (low, high), (first, last) = self.x_mm, self.yaw_deg
        return self.x_mm == self.y_mm and low == -high and first == 0 and last > 350

    @property
    def _pairs(self) -> tuple[SpreadRange, ...]:
        return self.x_mm, self.y_mm, self.z_mm, self.pitch_deg, self.yaw_deg


@dataclass(frozen=True, config=_STRICT)
class CadSettings:
    """The CAD file (STL, OBJ, GLB) of an instrument and its orientation there.

    axis: the file's axis along the instrument; None: the longest principal axis. tip: whether the
    tip is at the low or the high end of that axis; None: at the thinner end.
    """

    file: Path
    unit: Literal["mm", "cm", "m", "inch"]
    axis: Literal["x", "y", "z"] | None = None
    tip: Literal["low", "high"] | None = None


@dataclass(frozen=True, config=_STRICT)
class ShaftSettings:
    """The instrument: a straight steel rod with one of four tips, or `cad` instead."""

    diameter_mm: Positive
    length_mm: Positive
    tip: Tip
    bevel_mm: Positive
    jaw_angle_deg: Annotated[float, Field(ge=0, le=120)]
    cad: CadSettings | None

    def __post_init__(self) -> None:
        if self.tip in ("chamfered", "rounded") and not self.bevel_mm < self.diameter_mm / 2:
            raise ValueError(
                f"bevel_mm = {self.bevel_mm:g} must be less than half of "
                f"diameter_mm = {self.diameter_mm:g}"
            )
        least_mm = 4 * self.diameter_mm if self.tip == "forceps" else self.bevel_mm
        if self.cad is None and not self.length_mm > least_mm:
            raise ValueError(
                f"length_mm = {self.length_mm:g} must be more than {least_mm:g} for the tip "
                f"{self.tip!r}"
            )


@dataclass(frozen=True, config=_STRICT)
class SceneLook:
    """Light and steel, in which the stand-in for real images differs from the training images."""

    light_strength: PositiveRange
    light_kelvin: Annotated[tuple[Kelvin, Kelvin], _Ascending]
    ambient: NotNegativeRange
    steel_grey: UnitRange
    roughness: UnitRange


@dataclass(frozen=True, config=_STRICT)
class SceneSettings(SceneLook):
    """The random properties of a scene around the poses of one image."""

    instruments: Annotated[tuple[Count, Annotated[int, Field(ge=0, le=8)]], _Ascending]
    lens_radius_mm: NotNegative
    min_visible_px: PositiveInt
    light_shape: Literal["twin", "ring"]
    scratches: UnitRange
    anisotropy: UnitRange
    films: UnitRange
    coating_probability: Fraction
    coating_grey: Annotated[tuple[PositiveFraction, PositiveFraction], _Ascending]
    coating_roughness: UnitRange
    jaws_probability: Fraction
    contact_shadow: UnitRange
    occluder_probability: Fraction
    occluder_coverage: UnitRange
    crossing_probability: Fraction
    crossing_coverage: UnitRange


@dataclass(frozen=True, config=_STRICT)
class Distortion:
    """Radial distortion by OpenCV's k1 and k2; see `shaftpose.core.geometry.Camera`."""

    k1: Range
    k2: Range


@dataclass(frozen=True, config=_STRICT)
class LensLook:
    """Effects in which the stand-in for real images differs from the training images."""

    blur_px: NotNegativeRange
    haze: UnitRange
    vignette: UnitRange
    noise: NotNegativeRange


@dataclass(frozen=True, config=_STRICT)
class LensSettings(LensLook):
    """Effects of lens, air and sensor on the finished image."""

    motion_px: NotNegativeRange
    jpeg_quality: Annotated[tuple[Quality, Quality], _Ascending] | None
    distortion: Distortion
    field_px: Positive | None


@dataclass(frozen=True, config=_STRICT)
class RenderOptions:
    """The stored file and the device for Cycles."""

    jpeg_quality: Quality
    device: Literal["cpu", "cuda", "optix", "hip", "metal"] = "cpu"


@dataclass(frozen=True, config=_STRICT)
class RenderSettings:
    """Everything that determines the images of a rendered set except its backgrounds and seed."""

    camera: CameraSettings
    poses: PoseRanges
    shaft: ShaftSettings
    scene: SceneSettings
    lens: LensSettings
    samples: PositiveIntRange
    jpeg_quality: Quality
    device: Literal["cpu", "cuda", "optix", "hip", "metal"] = "cpu"

    def __post_init__(self) -> None:
        if self.scene.jaws_probability and (self.shaft.cad or self.shaft.tip == "forceps"):
            raise ValueError(
                f"scene.jaws_probability = {self.scene.jaws_probability:g}: an instrument with its "
                "own end (shaft.cad, or shaft.tip: forceps) cannot have jaws; set it to 0"
            )
        field_px, diagonal_px = self.lens.field_px, math.sqrt(2) * self.camera.size_px
        if field_px is not None and field_px >= diagonal_px:
            raise ValueError(
                f"lens.field_px = {field_px:g} has no effect: the diagonal of the rendered image "
                f"is {diagonal_px:.0f} px; set a smaller value, or null"
            )


@dataclass(frozen=True, config=_STRICT)
class SlurmSettings:
    """The resources of each of `jobs` Slurm jobs; memory as in 64GB, walltime as in 12:00:00."""

    queue: str | None
    cores: PositiveInt
    memory: Annotated[str, Field(pattern=r"^\d+ ?[kMGT]i?B$")]
    walltime: str
    jobs: PositiveInt


@dataclass(frozen=True, config=_STRICT)
class ClusterSettings:
    """Where rendering runs; see `shaftpose.farm.cluster`. No result depends on it."""

    workers: PositiveInt
    address: str | None
    slurm: SlurmSettings | None
    hang_s: Positive

    def __post_init__(self) -> None:
        if self.address is not None and self.slurm is not None:
            raise ValueError("address and slurm are both set; make one of them null")


@dataclass(frozen=True, config=_STRICT)
class RunSize:
    """The sizes of a run: one profile of conf/profiles.yaml, which explains the keys.

    At the least width, the backbone's first convolution has 8 channels; at the least depth, each of
    its three stages has one block: see `shaftpose.network.ssd.inception_v4`.
    """

    sources: PositiveInt
    variations: PositiveInt
    images: PositiveInt
    images_per_shard: PositiveInt
    samples: PositiveIntRange
    test_set: PositiveInt
    stand_in_images: PositiveInt
    width: Annotated[float, Field(ge=0.1875)]
    depth: Annotated[float, Field(ge=0.17)]
    symmetries: bool
    batch_size: PositiveInt
    detector_steps: PositiveInt
    steps: PositiveInt
    warmup_steps: Count
    validate_every: PositiveInt
    optimizer: Literal["adam", "muon"]
    learning_rate: Positive
    precision: Literal["auto", "32-true", "bf16-mixed", "16-mixed"]

    def __post_init__(self) -> None:
        for name, steps in (("detector_steps", self.detector_steps), ("steps", self.steps)):
            if not self.warmup_steps < steps:
                raise ValueError(
                    f"warmup_steps = {self.warmup_steps} must be less than {name} = {steps}"
                )


@dataclass(frozen=True, config=_STRICT)
class BackgroundSettings:
    """The source of backgrounds and their colour variations."""

    source: str | None
    hue_deg: Range
    saturation: NotNegativeRange
    brightness: NotNegativeRange
    held_out: Share


@dataclass(frozen=True, config=_STRICT)
class StandInSettings:
    """The look of rendered images that stand in for real ones."""

    scene: SceneLook
    lens: LensLook


@dataclass(frozen=True, config=_STRICT)
class RealSettings:
    """The user's folder of real images, or what stands in for it."""

    source: Path | None
    stand_in: StandInSettings


@dataclass(frozen=True, config=_STRICT)
class SplitSettings:
    """Method and shares of the split: see `shaftpose.dataset.split`."""

    method: Literal["grouped", "random"]
    test: Share
    validation: Share


@dataclass(frozen=True, config=_STRICT)
class Augmentation:
    """Ranges of random colour changes; see `shaftpose.dataset.colour_transforms`."""

    brightness: Range
    contrast: Range
    saturation: Range
    hue_deg: Range


@dataclass(frozen=True, config=_STRICT)
class TrainingSettings:
    """How a network is trained."""

    loader_workers: Count | None
    images_in_memory: bool
    checkpoint_minutes: NotNegative
    max_hours: Positive | None
    on_damaged: Literal["stop", "skip"]
    gradient_clip: Positive | None
    ema_decay: Share | None
    frozen_norm_share: Fraction
    keep_best: bool
    patience: PositiveInt | None
    compile: bool
    augmentation: Augmentation


@dataclass(frozen=True, config=_STRICT)
class Variant:
    """One variant of the ablation: conf/variant/`name`.yaml; c.yaml explains the keys."""

    name: str
    title: str
    network: Component
    loss: Component
    start: Path | None
    pose_loss: bool
    noise: Count
    real_share: Fraction
    symmetries: bool
    views: bool


@dataclass(frozen=True, config=_STRICT)
class LossSettings:
    """Weights of the paper's loss, for the files of variants to refer to."""

    alpha: NotNegative
    gamma: Positive
    beta: tuple[NotNegative, NotNegative, NotNegative, NotNegative, NotNegative]


@dataclass(frozen=True, config=_STRICT)
class DetectionSettings:
    """Limits of decoding, and the refinement of poses, see `shaftpose.settings.choices`.

    top_k, nms_iou: of the paper's networks alone, see `shaftpose.network.ssd.decoding`.
    """

    top_k: Annotated[int, Field(gt=0, le=7322)]  # the number of default boxes
    nms_iou: Fraction
    max_detections: PositiveInt
    confidence_threshold: Fraction | None
    refine: Refinement

    def __post_init__(self) -> None:
        if self.max_detections > self.top_k:
            raise ValueError(f"max_detections = {self.max_detections} exceeds top_k = {self.top_k}")


@dataclass(frozen=True, config=_STRICT)
class ReportSettings:
    """How the champion is chosen: see `shaftpose.report.champion`."""

    champion_margin: NotNegative


@dataclass(frozen=True, config=_STRICT)
class TrackingSettings:
    """Where MLflow keeps its records: see `shaftpose.tracking.connection`."""

    uri: str | None
    experiment: Annotated[str, Field(min_length=1)]


@dataclass(frozen=True, config=_STRICT)
class TrainerSettings:
    """Arguments of Lightning's Trainer: one file of conf/trainer."""

    accelerator: str
    devices: PositiveInt | str | list[int]
    num_nodes: PositiveInt = 1
    strategy: str = "auto"
    sync_batchnorm: bool = False
    benchmark: bool | None = None
