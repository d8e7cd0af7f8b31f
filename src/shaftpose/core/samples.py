"""One annotated image, and its files in a shard."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.core.images import Image, encode_jpeg
from shaftpose.core.masks import RunLengths
from shaftpose.core.shard_schema import CameraFile, ExtentEntry, PoseEntry, to_json


@dataclass(frozen=True)
class Instrument:
    """One shaft of one image: its visible mask and its amodal (visible and hidden) mask, (H, W).

    roll_deg: roll about its axis; 0 where no roll is visible.
    """

    pose: ShaftPose
    mask: NDArray[np.bool_]
    amodal_mask: NDArray[np.bool_]
    roll_deg: float = 0.0

    @property
    def visible_fraction(self) -> float:
        """The visible share of its pixels."""
        return int(self.mask.sum()) / int(self.amodal_mask.sum())


@dataclass(frozen=True)
class Sample:
    """One image (H, W, 3) with its annotations.

    scene_description: the renderer's description of the scene, for shaft.json; tool_mask: (H, W),
    the visible pixels of instruments that are no annotated shaft, such as jaws; None for none.
    """

    key: str
    rgb: Image
    instruments: tuple[Instrument, ...]
    camera: Camera
    scene_description: Mapping[str, Any]
    tool_mask: NDArray[np.bool_] | None = None


def sample_key(index: int) -> str:
    """The key of image `index`: nine digits, so that keys sort numerically."""
    return f"{index:09d}"


def encode_sample(sample: Sample, jpeg_quality: int) -> dict[str, bytes]:
    """The files of one sample: suffix -> bytes."""
    shafts, tool = sample.instruments, sample.tool_mask
    if tool is None:
        tool = np.zeros(sample.rgb.shape[:2], dtype=bool)
    contents: dict[str, Any] = {
        "camera.json": to_json(CameraFile.of(sample.camera)),
        "gt.json": [to_json(PoseEntry.of(shaft.pose, shaft.roll_deg)) for shaft in shafts],
        "gt_info.json": [to_json(ExtentEntry.of(s.mask, s.amodal_mask)) for s in shafts],
        "mask.json": _run_lengths([shaft.amodal_mask for shaft in shafts]),
        "mask_visib.json": _run_lengths([shaft.mask for shaft in shafts]),
        "mask_tool.json": to_json(RunLengths.of(tool)),
        "shaft.json": {
            "shafts": [vars(shaft.pose) for shaft in shafts],
            **sample.scene_description,
        },
    }
    return {"rgb.jpg": encode_jpeg(sample.rgb, jpeg_quality)} | {
        suffix: json.dumps(content).encode() for suffix, content in contents.items()
    }


def _run_lengths(masks: Sequence[NDArray[np.bool_]]) -> dict[str, Any]:
    return {str(number): to_json(RunLengths.of(mask)) for number, mask in enumerate(masks)}
