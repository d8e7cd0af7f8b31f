"""Strict reader of one rendered image in a shard.

It does not use `ShardedDataset`: a check of finished datasets should not share the reader that
training uses.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pydantic
from numpy.typing import NDArray
from pydantic import ConfigDict, TypeAdapter, ValidationError

from shaftpose.core.errors import InputError
from shaftpose.core.geometry import ShaftPose
from shaftpose.core.images import decode_rgb
from shaftpose.core.masks import RunLengths
from shaftpose.core.shard_schema import CameraFile, ExtentEntry, PoseEntry
from shaftpose.rendering.scene import Light, Steel
from shaftpose.settings.schema import Count

_FINITE = ConfigDict(allow_inf_nan=False)


@pydantic.dataclasses.dataclass(frozen=True, config=_FINITE)
class SceneFile:
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
    samples: Count
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


# Types of the JSON files. Lists hand their configuration on to their entries.
_KINDS: dict[str, TypeAdapter[Any]] = {
    "camera.json": TypeAdapter(
        pydantic.dataclasses.dataclass(CameraFile, frozen=True, config=_FINITE)
    ),
    "gt.json": TypeAdapter(list[PoseEntry], config=_FINITE),
    "gt_info.json": TypeAdapter(list[ExtentEntry], config=_FINITE),
    "mask.json": TypeAdapter(dict[str, RunLengths]),
    "mask_visib.json": TypeAdapter(dict[str, RunLengths]),
    "mask_tool.json": TypeAdapter(RunLengths),
    "shaft.json": TypeAdapter(SceneFile),
}


@dataclass(frozen=True)
class AnnotatedImage:
    """One image and its annotations, with one entry for each shaft in each list.

    masks: (H, W) each, the visible pixels; amodal_masks: (H, W) each, hidden ones too; tool_mask:
    (H, W), visible pixels of instruments that are no annotated shaft.
    """

    jpeg: bytes
    camera: CameraFile
    pose_entries: list[PoseEntry]
    extents: list[ExtentEntry]
    masks: list[NDArray[np.bool_]]
    amodal_masks: list[NDArray[np.bool_]]
    tool_mask: NDArray[np.bool_]
    scene: SceneFile


def read_image(members: Mapping[str, bytes], size_px: int) -> AnnotatedImage:
    """Read an image from its members, suffix -> bytes; image and masks are square.

    Raises InputError, which names the member and not the image, if a member is missing, cannot be
    decoded, has the wrong type or size, or disagrees about the number of shafts.
    """
    jpeg = _member(members, "rgb.jpg")
    _check_image(jpeg, size_px)
    parts = {suffix: _parse(_member(members, suffix), suffix) for suffix in _KINDS}
    scene: SceneFile = parts["shaft.json"]
    for suffix in ("gt.json", "gt_info.json", "mask.json", "mask_visib.json"):
        _agree(len(parts[suffix]), len(scene.shafts), suffix)
    _agree(len(scene.steels), len(scene.shafts), "shaft.json: steels")
    _agree(len(scene.rolls), len(scene.shafts), "shaft.json: rolls_deg")
    return AnnotatedImage(
        jpeg=jpeg,
        camera=parts["camera.json"],
        pose_entries=parts["gt.json"],
        extents=parts["gt_info.json"],
        masks=_masks(parts["mask_visib.json"], "mask_visib.json", size_px),
        amodal_masks=_masks(parts["mask.json"], "mask.json", size_px),
        tool_mask=_mask(parts["mask_tool.json"], "mask_tool.json: the mask", size_px),
        scene=scene,
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


def _masks(encoded: Mapping[str, RunLengths], suffix: str, size_px: int) -> list[NDArray[np.bool_]]:
    """The masks in the order of their numbers."""
    masks = []
    for number in range(len(encoded)):
        runs = encoded.get(str(number))
        if runs is None:
            raise InputError(f"{suffix}: no mask {number}, though there are {len(encoded)}")
        masks.append(_mask(runs, f"{suffix}: mask {number}", size_px))
    return masks


def _mask(runs: RunLengths, what: str, size_px: int) -> NDArray[np.bool_]:
    pixels = sum(runs.counts)
    if runs.size != (size_px, size_px) or pixels != size_px**2:
        raise InputError(
            f"{what} has {pixels} px and the size {runs.size}, not {size_px} x {size_px}"
        )
    if min(runs.counts) < 0:
        raise InputError(f"{what} has a run of {min(runs.counts)} px")
    return runs.mask()
