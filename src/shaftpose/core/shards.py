"""Datasets on disk: tar shards in BOP's WebDataset form, read by offset.

`shaftpose.core.shard_schema` and docs/data_format.md describe the files of an image.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.errors import InputError
from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.core.images import decode_rgb
from shaftpose.core.instruments import Annotations
from shaftpose.core.masks import RunLengths
from shaftpose.core.shard_index import (
    RENDER,
    Location,
    read_index,
    rerender,
    shard_paths,
    unreadable,
)
from shaftpose.core.shard_schema import CameraFile, ExtentEntry, from_json


class ShardedDataset:
    """Random access to the samples of a folder of shards without unpacking them.

    Raises InputError naming the files if the folder holds no shard, a shard is damaged or two
    shards hold the same image.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._members: dict[str, dict[str, Location]] = {}
        for path in shard_paths(folder):
            self._index(path)

    def _index(self, path: Path) -> None:
        for name, location in read_index(path).items():
            key, _, suffix = name.partition(".")
            members = self._members.setdefault(key, {})
            for other in members.values():
                if other.path != path:
                    raise InputError(
                        f"{path}: image {key} is also in {other.path}; remove one of the shards"
                    )
            members[suffix] = location

    @property
    def keys(self) -> list[str]:
        """The keys of all samples, ascending."""
        return sorted(self._members)

    def __len__(self) -> int:
        return len(self._members)

    def rgb(self, key: str) -> NDArray[np.uint8]:
        """The image (H, W, 3) uint8. Raises InputError naming shard and key if it is damaged."""
        path, data = self._read(key, "rgb.jpg")
        image = decode_rgb(data)
        if image is None:
            raise InputError(f"{path}: image {key} is damaged; {rerender([path])}")
        return image

    def annotations(self, key: str) -> Annotations:
        """Visible boxes and poses of one image; decodes neither image nor masks."""
        scene, infos = self.scene_description(key), self._json(key, "gt_info.json")
        try:
            poses = [ShaftPose(**shaft).as_array() for shaft in scene["shafts"]]
            boxes = [from_json(ExtentEntry, info).visible_corners for info in infos]
            both = [(*box, *pose) for box, pose in zip(boxes, poses, strict=True)]
            values = np.array(both, dtype=np.float64).reshape(-1, 9)
        except (KeyError, TypeError, ValueError) as error:
            raise self._damaged(key, "gt_info.json", "annotation") from error
        return Annotations(values[:, :4], values[:, 4:])

    def camera(self, key: str) -> Camera:
        """The camera of one image."""
        about = self._json(key, "camera.json")
        height, width = self.rgb(key).shape[:2]
        try:
            return from_json(CameraFile, about).camera(width, height)
        except (TypeError, ValueError) as error:
            raise self._damaged(key, "camera.json", "camera") from error

    def masks(self, key: str) -> list[NDArray[np.bool_]]:
        """The visible mask (H, W) of each instrument of one image."""
        encoded = self._json(key, "mask_visib.json")
        try:
            return [from_json(RunLengths, encoded[str(n)]).mask() for n in range(len(encoded))]
        except (KeyError, TypeError, ValueError) as error:
            raise self._damaged(key, "mask_visib.json", "mask") from error

    def tool_mask(self, key: str) -> NDArray[np.bool_]:
        """The visible pixels (H, W) of instruments in one image that are no annotated shaft."""
        encoded = self._json(key, "mask_tool.json")
        try:
            return from_json(RunLengths, encoded).mask()
        except (TypeError, ValueError) as error:
            raise self._damaged(key, "mask_tool.json", "mask") from error

    def visible_fractions(self, key: str) -> list[float]:
        """The visible share of each instrument of one image."""
        infos = self._json(key, "gt_info.json")
        try:
            return [float(from_json(ExtentEntry, info).visib_fract) for info in infos]
        except (TypeError, ValueError) as error:
            raise self._damaged(key, "gt_info.json", "visible share") from error

    def scene_description(self, key: str) -> dict[str, Any]:
        """The content of shaft.json: poses of the shafts, and the description of their scene."""
        description: dict[str, Any] = self._json(key, "shaft.json")
        return description

    def _json(self, key: str, suffix: str) -> Any:
        path, data = self._read(key, suffix)
        try:
            return json.loads(data)
        except ValueError as error:
            message = f"{path}: {key}.{suffix} is damaged; {rerender([path])}"
            raise InputError(message) from error

    def _damaged(self, key: str, suffix: str, what: str) -> InputError:
        path = self._location(key, suffix).path
        return InputError(f"{path}: the {what} of {key} is damaged; {rerender([path])}")

    def _read(self, key: str, suffix: str) -> tuple[Path, bytes]:
        """The shard and the bytes of a member. Raises InputError if the shard is gone."""
        location = self._location(key, suffix)
        path = location.path
        try:
            return path, location.read()
        except OSError as error:
            raise unreadable(path, error) from error

    def _location(self, key: str, suffix: str) -> Location:
        try:
            return self._members[key][suffix]
        except KeyError as error:
            raise InputError(f"{self.folder}: {key}.{suffix} is missing; {RENDER}") from error
