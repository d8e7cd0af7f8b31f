"""Strict reader of one rendered image in a shard.

It does not use `ShardedDataset`: a check of finished datasets should not share the reader that
training uses.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np
import pydantic
from numpy.typing import NDArray
from pydantic import ConfigDict, Field, TypeAdapter, ValidationError

from shaftpose.core.errors import InputError
from shaftpose.core.geometry import Array, ShaftPose
from shaftpose.core.images import decode_rgb
from shaftpose.core.masks import decode_mask
from shaftpose.settings.schema import Count

_FINITE = ConfigDict(allow_inf_nan=False)
_Matrix = Annotated[list[float], Field(min_length=9, max_length=9)]  # (3, 3), row by row
_Box = tuple[int, int, int, int]  # x, y, width, height


@pydantic.dataclasses.dataclass(frozen=True, config=_FINITE)
class CameraFacts:
    """camera.json; pinholes omit `distortion`, and images without a round field `field_px`."""

    cam_K: _Matrix
    distortion: tuple[float, float] = (0.0, 0.0)  # OpenCV's k1, k2
    field_px: float | None = None

    @property
    def intrinsics(self) -> Array:
        """(3, 3) the matrix K."""
        return np.array(self.cam_K).reshape(3, 3)


@pydantic.dataclasses.dataclass(frozen=True, config=_FINITE)
class ModelPose:
    """An entry of gt.json: the transformation from the shaft's to the camera's frame."""

    cam_R_m2c: _Matrix
    cam_t_m2c: tuple[float, float, float]
    obj_id: int

    @property
    def rotation(self) -> Array:
        """(3, 3) from shaft to camera frame."""
        return np.array(self.cam_R_m2c).reshape(3, 3)


@pydantic.dataclasses.dataclass(frozen=True, config=_FINITE)
class Extent:
    """An entry of gt_info.json: boxes as x, y, width, height px, and pixel counts."""

    bbox_obj: _Box
    bbox_visib: _Box
    px_count_all: int
    px_count_valid: int
    px_count_visib: int
    visib_fract: float


@pydantic.dataclasses.dataclass(frozen=True)
class _RunLengths:
    """An entry of mask.json or mask_visib.json."""

    counts: list[Count]
    size: tuple[int, int]


@pydantic.dataclasses.dataclass(frozen=True, config=_FINITE)
class Light:
    """The light of shaft.json."""

    strength: float
    kelvin: float
    ambient: float


@pydantic.dataclasses.dataclass(frozen=True, config=_FINITE)
class Steel:
    """The fields of a steel in shaft.json that checks use."""

    roughness: float


@pydantic.dataclasses.dataclass(frozen=True, config=_FINITE)
class SceneFacts:
    """The fields of shaft.json that checks use.

    seed, index: the seed of the image's set and its number there; rolls_deg: None where no roll is
    visible; crossing: number of shafts that pass in front of others.
    """

    shafts: list[ShaftPose]
    steels: list[Steel]
    light: Light
    occluders: list[Any]
    background: str
    source: str
    seed: Count
    index: Count
    tries: Count
    rolls_deg: list[float] | None = None
    crossing: Count = 0
    jaws: list[Any] = field(default_factory=list)  # one per shaft, None where there are none

    @property
    def hides_shafts(self) -> bool:
        """Whether something that has no mask may be in front of a shaft."""
        return bool(self.occluders) or any(self.jaws)

    @property
    def rolls(self) -> list[float]:
        """The roll of each shaft in deg."""
        return [0.0] * len(self.shafts) if self.rolls_deg is None else self.rolls_deg


# Type of each JSON member.
_KINDS: dict[str, TypeAdapter[Any]] = {
    "camera.json": TypeAdapter(CameraFacts),
    "gt.json": TypeAdapter(list[ModelPose]),
    "gt_info.json": TypeAdapter(list[Extent]),
    "mask.json": TypeAdapter(dict[str, _RunLengths]),
    "mask_visib.json": TypeAdapter(dict[str, _RunLengths]),
    "shaft.json": TypeAdapter(SceneFacts),
}


@dataclass(frozen=True)
class AnnotatedImage:
    """One image and its annotations, with one entry for each shaft in each list.

    masks: (H, W) each, the visible pixels; amodal_masks: (H, W) each, hidden ones too.
    """

    jpeg: bytes
    camera: CameraFacts
    model_poses: list[ModelPose]
    extents: list[Extent]
    masks: list[NDArray[np.bool_]]
    amodal_masks: list[NDArray[np.bool_]]
    facts: SceneFacts


def read_image(members: Mapping[str, bytes], size_px: int) -> AnnotatedImage:
    """Read an image from its members, suffix -> bytes; image and masks are square.

    Raises InputError, which names the member and not the image, if a member is missing, cannot be
    decoded, has the wrong type or size, or disagrees about the number of shafts.
    """
    jpeg = _member(members, "rgb.jpg")
    _check_image(jpeg, size_px)
    parts = {suffix: _parse(_member(members, suffix), suffix) for suffix in _KINDS}
    facts: SceneFacts = parts["shaft.json"]
    for suffix in ("gt.json", "gt_info.json", "mask.json", "mask_visib.json"):
        _agree(len(parts[suffix]), len(facts.shafts), suffix)
    _agree(len(facts.steels), len(facts.shafts), "shaft.json: steels")
    _agree(len(facts.rolls), len(facts.shafts), "shaft.json: rolls_deg")
    return AnnotatedImage(
        jpeg=jpeg,
        camera=parts["camera.json"],
        model_poses=parts["gt.json"],
        extents=parts["gt_info.json"],
        masks=_masks(parts["mask_visib.json"], "mask_visib.json", size_px),
        amodal_masks=_masks(parts["mask.json"], "mask.json", size_px),
        facts=facts,
    )


def _member(members: Mapping[str, bytes], suffix: str) -> bytes:
    if suffix not in members:
        raise InputError(f"{suffix}: missing")
    return members[suffix]


def _check_image(jpeg: bytes, size_px: int) -> None:
    rgb = decode_rgb(jpeg)
    if rgb is None:
        raise InputError(f"rgb.jpg: {len(jpeg)} bytes that are not a complete JPEG image")
    height, width = rgb.shape[:2]
    if (width, height) != (size_px, size_px):
        raise InputError(f"rgb.jpg: {width} x {height} px, not {size_px} x {size_px}")


def _parse(data: bytes, suffix: str) -> Any:
    try:
        return _KINDS[suffix].validate_json(data)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        found = str(first["input"])[:60]  # the whole content if it is not JSON
        raise InputError(f"{suffix}: {where or 'content'} = {found!r}: {first['msg']}") from error


def _agree(found: int, shafts: int, where: str) -> None:
    if found != shafts:
        raise InputError(f"{where}: {found} entries for the {shafts} shafts of shaft.json")


def _masks(
    encoded: Mapping[str, _RunLengths], suffix: str, size_px: int
) -> list[NDArray[np.bool_]]:
    """The masks in the order of their numbers."""
    masks = []
    for number in range(len(encoded)):
        runs = encoded.get(str(number))
        if runs is None:
            raise InputError(f"{suffix}: no mask {number}, though there are {len(encoded)}")
        pixels = sum(runs.counts)
        if runs.size != (size_px, size_px) or pixels != size_px**2:
            raise InputError(
                f"{suffix}: mask {number} has {pixels} px and the size {runs.size}, not "
                f"{size_px} x {size_px}"
            )
        masks.append(decode_mask({"counts": runs.counts, "size": runs.size}))
    return masks
