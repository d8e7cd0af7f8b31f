"""One annotated image, and the members of a shard that hold it: BOP's, and `.shaft.json`."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.core.images import encode_jpeg
from shaftpose.core.masks import encode_mask, mask_box

SHAFT_OBJECT_ID = 1
# The members of one sample.
SUFFIXES = (
    "rgb.jpg",
    "camera.json",
    "gt.json",
    "gt_info.json",
    "mask.json",
    "mask_visib.json",
    "shaft.json",
)


@dataclass(frozen=True)
class Instrument:
    """One shaft of one image: its visible mask and its amodal (visible and hidden) mask, (H, W)."""

    pose: ShaftPose
    mask: NDArray[np.bool_]
    amodal_mask: NDArray[np.bool_]
    roll_deg: float = 0.0  # about its axis, where it is visible

    @property
    def visible_fraction(self) -> float:
        """The visible share of its pixels."""
        return int(self.mask.sum()) / int(self.amodal_mask.sum())


@dataclass(frozen=True)
class Sample:
    """One image with its annotations; `rgb` is (H, W, 3) uint8."""

    key: str
    rgb: NDArray[np.uint8]
    instruments: tuple[Instrument, ...]
    camera: Camera
    facts: Mapping[str, Any]  # background, light, seeds: the free part of shaft.json


def sample_key(index: int) -> str:
    """The key of image `index`: nine digits, so that keys sort numerically."""
    return f"{index:09d}"


def encode_sample(sample: Sample, jpeg_quality: int) -> dict[str, bytes]:
    """The members of one sample, suffix -> bytes."""
    parts: dict[str, Any] = {
        "camera.json": _bop_camera(sample.camera),
        "gt.json": [_bop_pose(i) for i in sample.instruments],
        "gt_info.json": [_bop_info(i) for i in sample.instruments],
        "mask.json": _masks([i.amodal_mask for i in sample.instruments]),
        "mask_visib.json": _masks([i.mask for i in sample.instruments]),
        "shaft.json": {
            "shafts": [vars(i.pose) for i in sample.instruments],
            **sample.facts,
        },
    }
    return {"rgb.jpg": encode_jpeg(sample.rgb, jpeg_quality)} | {
        name: json.dumps(part).encode() for name, part in parts.items()
    }


def _masks(masks: Sequence[NDArray[np.bool_]]) -> dict[str, Any]:
    return {str(n): encode_mask(mask) for n, mask in enumerate(masks)}


def _bop_camera(camera: Camera) -> dict[str, Any]:
    """BOP's keys, plus `distortion` and `field_px` for cameras that are not plain pinholes."""
    about: dict[str, Any] = {"cam_K": camera.matrix.ravel().tolist(), "depth_scale": 1.0}
    if camera.k1 or camera.k2:
        about["distortion"] = [camera.k1, camera.k2]
    if camera.field_px is not None:
        about["field_px"] = camera.field_px
    return about


def _bop_pose(instrument: Instrument) -> dict[str, Any]:
    return {
        "cam_R_m2c": instrument.pose.rolled(instrument.roll_deg).ravel().tolist(),
        "cam_t_m2c": instrument.pose.tip_mm.tolist(),
        "obj_id": SHAFT_OBJECT_ID,
    }


def _bop_info(instrument: Instrument) -> dict[str, Any]:
    pixels = int(instrument.amodal_mask.sum())
    return {
        "bbox_obj": _corner_and_size(mask_box(instrument.amodal_mask)),
        "bbox_visib": _corner_and_size(mask_box(instrument.mask)),
        "px_count_all": pixels,
        "px_count_valid": pixels,
        "px_count_visib": int(instrument.mask.sum()),
        "visib_fract": instrument.visible_fraction,
    }


def _corner_and_size(box: tuple[int, int, int, int]) -> list[int]:
    """A box in BOP's form: x, y, width, height."""
    x0, y0, x1, y1 = box
    return [x0, y0, x1 - x0, y1 - y0]


def corners(box: Sequence[int]) -> tuple[int, int, int, int]:
    """A box x0, y0, x1, y1 from BOP's form."""
    x, y, width, height = box
    return x, y, x + width, y + height
