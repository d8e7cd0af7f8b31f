"""Schema of the files that a shard holds for each image: BOP's, and our own `shaft.json`.

The writer, the reader and the inspector of shards share these types. A field's name is its JSON
key; a field at its default is omitted. `shaft.json` is a dictionary with the poses of the `shafts`
and the renderer's description of the scene. Lengths are mm, boxes px.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.geometry import Array, Camera, ShaftPose
from shaftpose.core.masks import mask_box

SHAFT_OBJECT_ID = 1
# Endings of the files' names, in the order of a shard; the image's key comes first.
SUFFIXES = (
    "rgb.jpg",
    "camera.json",
    "gt.json",
    "gt_info.json",
    "mask.json",
    "mask_visib.json",
    "mask_tool.json",
    "shaft.json",
)

_Matrix = tuple[float, float, float, float, float, float, float, float, float]  # row by row
_Box = tuple[int, int, int, int]  # x, y, width, height
_Entry = TypeVar("_Entry")


@dataclass(frozen=True)
class CameraFile:
    """camera.json. distortion: OpenCV's k1, k2; field_px: diameter of a round picture around the
    principal point, None without one."""

    cam_K: _Matrix
    depth_scale: float
    distortion: tuple[float, float] = (0.0, 0.0)
    field_px: float | None = None

    @classmethod
    def of(cls, camera: Camera) -> "CameraFile":
        """The file of a camera."""
        field_px = None if camera.field is None else camera.field.diameter
        return cls(_flat(camera.matrix), 1.0, (camera.k1, camera.k2), field_px)

    def camera(self, width: int, height: int) -> Camera:
        """The camera of an image of this size. Raises ValueError if the matrix is too short."""
        focal_px, _, cx, _, _, cy, *_ = self.cam_K
        camera = Camera(width, height, focal_px, cx, cy, *self.distortion)
        return replace(camera, field=camera.disc(self.field_px))


@dataclass(frozen=True)
class PoseEntry:
    """One instrument of gt.json: the transformation from the shaft's to the camera's frame."""

    cam_R_m2c: _Matrix
    cam_t_m2c: tuple[float, float, float]
    obj_id: int

    @classmethod
    def of(cls, pose: ShaftPose, roll_deg: float) -> "PoseEntry":
        """The entry of a shaft rolled about its axis."""
        x_mm, y_mm, z_mm = pose.tip_mm.tolist()
        return cls(_flat(pose.rolled(roll_deg)), (x_mm, y_mm, z_mm), SHAFT_OBJECT_ID)


@dataclass(frozen=True)
class ExtentEntry:
    """One instrument of gt_info.json: boxes and pixel counts of its amodal and its visible mask."""

    bbox_obj: _Box
    bbox_visib: _Box
    px_count_all: int
    px_count_valid: int
    px_count_visib: int
    visib_fract: float

    @classmethod
    def of(cls, mask: NDArray[np.bool_], amodal_mask: NDArray[np.bool_]) -> "ExtentEntry":
        """The entry of an instrument with these masks (H, W). Raises ValueError if one is empty."""
        visible, whole = int(mask.sum()), int(amodal_mask.sum())
        boxes = corner_and_size(amodal_mask), corner_and_size(mask)
        return cls(*boxes, whole, whole, visible, visible / whole)

    @property
    def visible_corners(self) -> tuple[int, int, int, int]:
        """The visible part's box as x0, y0, x1, y1."""
        x, y, width, height = self.bbox_visib
        return x, y, x + width, y + height


def to_json(entry: Any) -> dict[str, Any]:
    """An entry as JSON values."""
    values = {field: getattr(entry, field.name) for field in fields(entry)}
    return {field.name: value for field, value in values.items() if value != field.default}


def from_json(kind: type[_Entry], values: Mapping[str, Any]) -> _Entry:
    """An entry from JSON values, whose types are not checked; other keys are ignored.

    Raises TypeError if a key is missing.
    """
    names = [field.name for field in fields(cast(Any, kind)) if field.name in values]
    return kind(**{name: values[name] for name in names})


def corner_and_size(mask: NDArray[np.bool_]) -> tuple[int, int, int, int]:
    """The box x, y, width, height of a mask (H, W). Raises ValueError if it is empty."""
    x0, y0, x1, y1 = mask_box(mask)
    return x0, y0, x1 - x0, y1 - y0


def _flat(matrix: Array) -> _Matrix:
    return cast(_Matrix, tuple(matrix.ravel().tolist()))
