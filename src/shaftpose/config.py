"""Settings as small frozen dataclasses that check types and ranges.

`params.yaml` and `conf/` compose to nested mappings; `parse` turns a part of them into one of these
classes or fails with one line that names the key, the value and what is allowed.
"""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import AfterValidator, ConfigDict, Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from shaftpose.errors import InputError

T = TypeVar("T")

# Keys that files of older versions lack, with values by which they keep their meaning.
_NEW_KEYS = {
    "depth": "depth: 1.0",
    "detector_steps": "detector_steps: 1000",  # used only where a variant starts from the detector
    "optimizer": "optimizer: adam",
    "start": "start: null",
    "pose_loss": "pose_loss: true",
    "symmetries": "symmetries: false",
}

_STRICT = ConfigDict(extra="forbid", allow_inf_nan=False)


def _ascending(pair: tuple[float, float]) -> tuple[float, float]:
    if pair[0] > pair[1]:
        raise ValueError(f"the lower end {pair[0]:g} is above the upper end {pair[1]:g}; swap them")
    return pair


def _spread(pair: tuple[float, float]) -> tuple[float, float]:
    if not pair[0] < pair[1]:
        raise ValueError("the upper end must lie above the lower end: poses are normalised by it")
    return pair


def _ascending_counts(pair: tuple[int, int]) -> tuple[int, int]:
    _ascending(pair)
    return pair


def _fractions(pair: tuple[float, float]) -> tuple[float, float]:
    if not 0 <= pair[0] <= pair[1] <= 1:
        raise ValueError("both ends must lie in [0, 1], the lower one first")
    return pair


def _not_negative(pair: tuple[float, float]) -> tuple[float, float]:
    if pair[0] < 0:
        raise ValueError("the lower end must not be negative")
    return pair


def _colour_temperatures(pair: tuple[float, float]) -> tuple[float, float]:
    if not 3000 <= pair[0] <= pair[1] <= 10000:
        raise ValueError("both ends must lie in [3000, 10000] K, the lower one first")
    return pair


def _above_zero(pair: tuple[float, float]) -> tuple[float, float]:
    if pair[0] <= 0:
        raise ValueError("the lower end must lie above 0")
    return pair


def _qualities(pair: tuple[int, int]) -> tuple[int, int]:
    if not 1 <= pair[0] <= pair[1] <= 100:
        raise ValueError("both ends must lie in [1, 100], the lower one first")
    return pair


def _half_turn(pair: tuple[float, float]) -> tuple[float, float]:
    if pair[0] < 0 or pair[1] > 180:
        raise ValueError("both ends must lie in [0, 180] deg: others are the same shaft once more")
    return pair


def _one_turn(pair: tuple[float, float]) -> tuple[float, float]:
    if pair[1] - pair[0] > 360:
        raise ValueError("must span 360 deg at most: others are the same shaft once more")
    return pair


Range = Annotated[tuple[float, float], AfterValidator(_ascending)]
PositiveRange = Annotated[Range, AfterValidator(_not_negative)]
SpreadRange = Annotated[tuple[float, float], AfterValidator(_spread)]
KelvinRange = Annotated[tuple[float, float], AfterValidator(_colour_temperatures)]
UnitRange = Annotated[tuple[float, float], AfterValidator(_fractions)]
QualityRange = Annotated[tuple[int, int], AfterValidator(_qualities)]
Count = Annotated[int, Field(ge=0)]
PositiveInt = Annotated[int, Field(gt=0)]
Positive = Annotated[float, Field(gt=0)]
Fraction = Annotated[float, Field(ge=0, le=1)]
InstrumentCounts = Annotated[
    tuple[Annotated[int, Field(ge=0)], Annotated[int, Field(ge=0, le=8)]],
    AfterValidator(_ascending_counts),
]


@dataclass(frozen=True, config=_STRICT)
class CameraSettings:
    """The endoscope: a square image of `size_px` and the angle across it (paper, II)."""

    size_px: Literal[299]  # the network's input
    view_deg: Annotated[float, Field(gt=0, lt=170)]


@dataclass(frozen=True, config=_STRICT)
class PoseRanges:
    """Ranges that poses are drawn from and normalised by (paper, Table of ranges)."""

    x_mm: SpreadRange
    y_mm: SpreadRange
    z_mm: Annotated[SpreadRange, AfterValidator(_above_zero)]  # in front of the camera
    pitch_deg: Annotated[SpreadRange, AfterValidator(_half_turn)]
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
    def _pairs(self) -> tuple[SpreadRange, ...]:
        return self.x_mm, self.y_mm, self.z_mm, self.pitch_deg, self.yaw_deg


@dataclass(frozen=True, config=_STRICT)
class CadSettings:
    """The file (STL, OBJ, GLB) of an instrument and how it lies in it.

    axis: the file's axis along the instrument; None: the longest principal axis. tip: whether the
    tip is at the low or the high end of that axis; None: at the thinner end.
    """

    file: Path
    unit: Literal["mm", "cm", "m", "inch"]
    axis: Literal["x", "y", "z"] | None = None
    tip: Literal["low", "high"] | None = None


@dataclass(frozen=True, config=_STRICT)
class ShaftSettings:
    """The instrument: a straight steel rod with one of four tips, or `cad` in place of all that.

    bevel_mm: width of the chamfer, or radius of the rounding, around the tip; jaw_angle_deg: angle
    between the jaws of a forceps.
    """

    diameter_mm: Positive
    length_mm: Positive
    tip: Literal["flat", "chamfered", "rounded", "forceps"]
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
                f"length_mm = {self.length_mm:g} must be more than {least_mm:g}, the length of the "
                f"tip {self.tip!r}"
            )


@dataclass(frozen=True, config=_STRICT)
class SceneSettings:
    """What is drawn at random around the poses of one image.

    instruments: fewest and most shafts; lens_radius_mm: sphere around the camera that no shaft
    cuts; min_visible_px: a shaft with fewer visible pixels is drawn again; light_strength: radiant
    power of the scope's light in W; light_shape: two light guides beside the lens or a ring around
    it; ambient: brightness of the background as the metal sees it, 1 is as photographed; roughness:
    of the steel; scratches: strength of the normal map; anisotropy: how much highlights are drawn
    out, as on turned steel; films: share of a shaft's surface under blood or clear fluid;
    contact_shadow: how much the shafts darken the background beside them; occluder_probability:
    chance that tissue hides part of an image's shafts; occluder_coverage: hidden share of each of
    these shafts; crossing_probability: chance of a further shaft, annotated like the others, that
    passes before one of them; crossing_coverage: the share that it hides of the one of which it
    hides most, always more than nothing.
    """

    instruments: InstrumentCounts
    lens_radius_mm: Annotated[float, Field(ge=0)]
    min_visible_px: PositiveInt
    light_strength: PositiveRange
    light_kelvin: KelvinRange
    light_shape: Literal["twin", "ring"]
    ambient: PositiveRange
    steel_grey: UnitRange
    roughness: UnitRange
    scratches: UnitRange
    anisotropy: UnitRange
    films: UnitRange
    contact_shadow: UnitRange
    occluder_probability: Fraction
    occluder_coverage: UnitRange
    crossing_probability: Fraction
    crossing_coverage: UnitRange


@dataclass(frozen=True, config=_STRICT)
class Distortion:
    """Radial distortion by OpenCV's k1 and k2; see `shaftpose.geometry.Camera`."""

    k1: Range
    k2: Range


@dataclass(frozen=True, config=_STRICT)
class LensSettings:
    """What lens, air and sensor do to the finished image; nothing in the paper's setting.

    blur_px: standard deviation of the defocus; motion_px: way of the image during the exposure;
    haze: opacity of surgical smoke; vignette: darkening at the corners; noise: standard deviation
    of sensor noise in grey levels of 255; jpeg_quality: of the recorder, whose compression comes
    before that of the stored file; field_px: diameter of the round picture of a scope. Pixels are
    those of the rendered image, of `camera.size_px`.
    """

    blur_px: PositiveRange
    motion_px: PositiveRange
    haze: UnitRange
    vignette: UnitRange
    noise: PositiveRange
    jpeg_quality: QualityRange | None
    distortion: Distortion
    field_px: Positive | None


@dataclass(frozen=True, config=_STRICT)
class RenderSettings:
    """Everything that determines the images of a rendered set besides its backgrounds and seed.

    device: what Cycles renders on; the CPU where Blender finds no such device.
    """

    camera: CameraSettings
    poses: PoseRanges
    shaft: ShaftSettings
    scene: SceneSettings
    lens: LensSettings
    samples: PositiveInt
    jpeg_quality: Annotated[int, Field(ge=1, le=100)]
    device: Literal["cpu", "cuda", "optix", "hip", "metal"] = "cpu"

    def __post_init__(self) -> None:
        field_px, diagonal_px = self.lens.field_px, math.sqrt(2) * self.camera.size_px
        if field_px is not None and field_px >= diagonal_px:
            raise ValueError(
                f"lens.field_px = {field_px:g} blackens nothing: the diagonal of the rendered "
                f"image, in whose pixels it is, has {diagonal_px:.0f}; make it less, or null"
            )


@dataclass(frozen=True, config=_STRICT)
class SlurmSettings:
    """What each of `jobs` jobs asks Slurm for; memory as in 64GB, walltime as in 12:00:00."""

    queue: str | None
    cores: PositiveInt
    memory: Annotated[str, Field(pattern=r"^\d+ ?[kMGT]i?B$")]
    walltime: str
    jobs: PositiveInt


@dataclass(frozen=True, config=_STRICT)
class ClusterSettings:
    """Who renders; see `shaftpose.rendering.cluster`. No result depends on it.

    workers: processes on this machine, unless an address of a scheduler or Slurm is given; hang_s:
    a Blender that finishes no image for so many seconds is ended.
    """

    workers: PositiveInt
    address: str | None
    slurm: SlurmSettings | None
    hang_s: Positive

    def __post_init__(self) -> None:
        if self.address is not None and self.slurm is not None:
            raise ValueError("address and slurm are both set; make one of them null")


@dataclass(frozen=True, config=_STRICT)
class Size:
    """The sizes of a run: one profile of conf/profiles.yaml, which explains the keys."""

    sources: PositiveInt
    variations: PositiveInt
    images: PositiveInt
    images_per_shard: PositiveInt
    samples: PositiveInt
    test_set: PositiveInt
    real: PositiveInt
    width: Positive
    depth: Positive
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
    """Where backgrounds come from and how their colours vary; factors are of saturation and
    brightness."""

    source: str | None
    hue_deg: Range
    saturation: PositiveRange
    brightness: PositiveRange
    held_out: Annotated[float, Field(gt=0, lt=1)]


@dataclass(frozen=True, config=_STRICT)
class SplitSettings:
    """Shares of the images that test and validate; see `shaftpose.dataset.split`."""

    method: Literal["grouped", "random"]
    test: Annotated[float, Field(gt=0, lt=1)]
    validation: Annotated[float, Field(gt=0, lt=1)]


@dataclass(frozen=True, config=_STRICT)
class StandInSettings:
    """What of the scene and of the lens the stand-in for real images replaces."""

    scene: dict[str, Any]
    lens: dict[str, Any]


@dataclass(frozen=True, config=_STRICT)
class RealSettings:
    """Where images without poses come from; None: from the stand-in."""

    source: str | None
    stand_in: StandInSettings


@dataclass(frozen=True, config=_STRICT)
class Augmentation:
    """Ranges of random colour changes; see `shaftpose.dataset.transforms`.

    symmetries: whether images are mirrored and turned; see `shaftpose.dataset.symmetries`.
    """

    brightness: Range
    contrast: Range
    saturation: Range
    hue_deg: Range
    symmetries: bool


@dataclass(frozen=True, config=_STRICT)
class TrainingSettings:
    """How a network is trained: params.yaml explains the keys."""

    loader_workers: Count | None
    checkpoint_minutes: Annotated[float, Field(ge=0)]
    max_hours: Positive | None
    on_damaged: Literal["stop", "skip"]
    gradient_clip: Positive | None
    ema_decay: Annotated[float, Field(gt=0, lt=1)] | None
    frozen_norm_share: Fraction
    compile: bool
    augmentation: Augmentation


@dataclass(frozen=True, config=_STRICT)
class Variant:
    """What distinguishes a variant besides its head and its pose coder.

    start: checkpoint of a detector whose weights a training begins with, None for random ones;
    pose_loss: whether L_pose counts, or the network becomes a detector for others to start from;
    noise: half-width of the uniform noise on half of the training images, grey levels; real_share:
    share of real images in training.
    """

    name: str
    title: str
    start: Path | None
    pose_loss: bool
    noise: Count
    real_share: Fraction


@dataclass(frozen=True, config=_STRICT)
class LossSettings:
    """Weights of the loss (paper, loss function); beta in the order x, y, z, pitch, yaw."""

    alpha: Annotated[float, Field(ge=0)]
    gamma: Positive
    beta: Annotated[tuple[Annotated[float, Field(ge=0)], ...], Field(min_length=5, max_length=5)]


@dataclass(frozen=True, config=_STRICT)
class DetectionSettings:
    """From candidates to detections: see `shaftpose.network.decoding`."""

    candidates: Annotated[int, Field(gt=0, le=7322)]  # there are no more default boxes
    overlap: Fraction
    most: PositiveInt
    confidence: Fraction | None

    def __post_init__(self) -> None:
        if self.most > self.candidates:
            raise ValueError(f"most = {self.most} exceeds candidates = {self.candidates}")


@dataclass(frozen=True, config=_STRICT)
class ReportSettings:
    """How the champion is chosen: see `shaftpose.evaluation.ablation`."""

    champion_margin: Annotated[float, Field(ge=0)]


@dataclass(frozen=True, config=_STRICT)
class TrackingSettings:
    """Where MLflow keeps its records: see `shaftpose.tracking.connect`."""

    uri: str | None
    experiment: Annotated[str, Field(min_length=1)]


@dataclass(frozen=True, config=_STRICT)
class RunSettings:
    """What is no part of a stage's own settings; variants: files of conf/variant/ to compare."""

    seed: Annotated[int, Field(ge=0, lt=2**31)]
    variants: Annotated[tuple[str, ...], Field(min_length=1)]


def parse(kind: type[T], values: Mapping[str, Any], where: str) -> T:
    """`values` as a `kind`.

    where: how the user finds the values, e.g. "params.yaml: loss"; it opens the message.
    Raises InputError naming the first key that is wrong, its value and what is allowed.
    """
    if not isinstance(values, Mapping):
        raise InputError(f"{where} = {values!r}: must hold keys and values")
    try:
        return TypeAdapter(kind).validate_python(dict(values))
    except ValidationError as error:
        raise InputError(_first_complaint(error, where)) from error


def _first_complaint(error: ValidationError, where: str) -> str:
    first = error.errors()[0]
    key = ".".join(str(part) for part in first["loc"])
    if first["type"] == "missing":
        return f"{where}.{key} is missing; add {_NEW_KEYS.get(key, 'it')}"
    message = first["msg"].removeprefix("Value error, ")
    if not key:  # of several keys together
        return f"{where}: {message}"
    return f"{where}.{key} = {first['input']!r}: {message}"


def to_json(settings: object) -> str:
    """A settings object as JSON; `from_json` reads it back."""
    return TypeAdapter(type(settings)).dump_json(settings, indent=1).decode()


def from_json(kind: type[T], path: Path) -> T:
    """A settings object from a JSON file. Raises InputError naming the file."""
    try:
        values = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read as JSON ({error}); write it again") from error
    return parse(kind, values, str(path))
