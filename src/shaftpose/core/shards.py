"""Datasets on disk: tar shards in BOP's WebDataset form, read by offset.

`shaftpose.core.shard_schema` and docs/data_format.md describe the files of an image.
"""

import json
import tarfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.errors import InputError
from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.core.images import decode_rgb
from shaftpose.core.instruments import Annotations
from shaftpose.core.masks import RunLengths
from shaftpose.core.shard_schema import SUFFIXES, CameraFile, ExtentEntry, from_json


@dataclass(frozen=True)
class Location:
    """Byte range of one member: `size` bytes at `offset` of `path`."""

    path: Path
    offset: int
    size: int

    def read(self) -> bytes:
        """The bytes. Opens the file each time, so processes can exchange locations."""
        with self.path.open("rb") as file:
            file.seek(self.offset)
            return file.read(self.size)


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
        for name, location in _read_index(path).items():
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
            raise InputError(f"{path}: image {key} is damaged; {render_anew([path])}")
        return image

    def annotations(self, key: str) -> Annotations:
        """Visible boxes and poses of one image; decodes neither image nor masks."""
        facts, infos = self.facts(key), self._json(key, "gt_info.json")
        try:
            poses = [ShaftPose(**shaft).as_array() for shaft in facts["shafts"]]
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

    def visible_fractions(self, key: str) -> list[float]:
        """The visible share of each instrument of one image."""
        infos = self._json(key, "gt_info.json")
        try:
            return [float(from_json(ExtentEntry, info).visib_fract) for info in infos]
        except (TypeError, ValueError) as error:
            raise self._damaged(key, "gt_info.json", "visible share") from error

    def facts(self, key: str) -> dict[str, Any]:
        """The content of shaft.json."""
        facts: dict[str, Any] = self._json(key, "shaft.json")
        return facts

    def _json(self, key: str, suffix: str) -> Any:
        path, data = self._read(key, suffix)
        try:
            return json.loads(data)
        except ValueError as error:
            message = f"{path}: {key}.{suffix} is damaged; {render_anew([path])}"
            raise InputError(message) from error

    def _damaged(self, key: str, suffix: str, what: str) -> InputError:
        path = self._location(key, suffix).path
        return InputError(f"{path}: the {what} of {key} is damaged; {render_anew([path])}")

    def _read(self, key: str, suffix: str) -> tuple[Path, bytes]:
        """The shard and the bytes of a member. Raises InputError if the shard is gone."""
        location = self._location(key, suffix)
        path = location.path
        try:
            return path, location.read()
        except OSError as error:
            raise _unreadable(path, error) from error

    def _location(self, key: str, suffix: str) -> Location:
        try:
            return self._members[key][suffix]
        except KeyError as error:
            raise InputError(f"{self.folder}: {key}.{suffix} is missing; {_RENDER}") from error


_RENDER = "run `dvc repro -s -f render` (for your own shards: write them again)"


def render_anew(shards: Iterable[Path]) -> str:
    """The remedy for complete shards with wrong content: existing shards are not rendered
    again."""
    names = ", ".join(sorted({shard.name for shard in shards}))
    return f"delete {names} in all folders of data/scratch, then {_RENDER}"


class _DamagedShardError(InputError):
    """A shard that is truncated, or whose headers are damaged."""


def is_whole(path: Path) -> bool:
    """Whether a shard's headers are intact and nothing is truncated. The members' content is not
    checked. Raises InputError if it cannot be read."""
    try:
        _read_index(path)
    except _DamagedShardError:
        return False
    return True


def holds(path: Path, keys: Iterable[str]) -> bool:
    """Whether a shard is complete: it holds all members of the samples `keys`, and no others.
    Raises InputError if it cannot be read."""
    try:
        names = _read_index(path).keys()
    except _DamagedShardError:
        return False
    return names == {f"{key}.{suffix}" for key in keys for suffix in SUFFIXES}


def _read_index(path: Path) -> dict[str, Location]:
    """Location of each member of a shard, by name.

    Raises InputError if the shard is damaged or cannot be read.
    """
    try:
        with tarfile.open(path, "r:") as tar:
            members = {m.name: Location(path, m.offset_data, m.size) for m in tar}
        end = max((m.offset + m.size for m in members.values()), default=0)
        whole = _ends_as_written(path, end)
    except OSError as error:
        raise _unreadable(path, error) from error
    except tarfile.TarError as error:
        raise _damaged(path) from error
    if not whole:
        raise _damaged(path)
    return members


def _ends_as_written(path: Path, end: int) -> bool:
    """Whether only the archive's zero blocks follow the last member's `end`: tarfile stops
    silently at a truncation or a damaged header."""
    with path.open("rb") as file:
        file.seek(end)
        rest = file.read()
    blocks = len(rest) // tarfile.BLOCKSIZE
    return (end + len(rest)) % tarfile.RECORDSIZE == 0 and blocks >= 2 and not any(rest)


def _unreadable(path: Path, error: OSError) -> InputError:
    return InputError(f"{path}: cannot be read ({error.strerror}); {render_anew([path])}")


def _damaged(path: Path) -> _DamagedShardError:
    return _DamagedShardError(f"{path}: the shard is truncated or damaged; {_RENDER}")


def shard_paths(folder: Path) -> list[Path]:
    """The complete shards of a folder, in order. Raises InputError if there is none."""
    paths = sorted(folder.glob("shard-*.tar"))
    if not paths:
        inner = sorted({path.parent.name for path in folder.glob("*/shard-*.tar")})
        remedy = f"name one of its folders: {', '.join(inner)}" if inner else _RENDER
        raise InputError(f"{folder}: no shard-*.tar in it; {remedy}")
    return paths
