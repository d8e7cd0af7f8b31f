"""Indexes of tar shards: which files they hold, where, and whether they are complete."""

import tarfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from shaftpose.core.errors import InputError
from shaftpose.core.shard_schema import SUFFIXES

RENDER = "run `dvc repro -s -f render` (for your own shards: write them again)"


def rerender(shards: Iterable[Path]) -> str:
    """The remedy for complete shards with wrong content, which would not be rendered again."""
    names = ", ".join(sorted({shard.name for shard in shards}))
    return f"delete {names} in all folders of data/scratch, then {RENDER}"


@dataclass(frozen=True)
class Location:
    """Byte range of one file in a shard: `size` bytes at `offset` of `path`."""

    path: Path
    offset: int
    size: int

    def read(self) -> bytes:
        """The bytes. Opens the file each time, so processes can exchange locations."""
        with self.path.open("rb") as file:
            file.seek(self.offset)
            return file.read(self.size)


class _DamagedShardError(InputError):
    """A shard that is truncated, or whose headers are damaged."""


def is_whole(path: Path) -> bool:
    """Whether a shard's headers are intact and nothing is truncated.

    Does not check the files' content. Raises InputError if the shard cannot be read.
    """
    try:
        read_index(path)
    except _DamagedShardError:
        return False
    return True


def holds(path: Path, keys: Iterable[str]) -> bool:
    """Whether a shard is complete: it holds all files of the samples `keys`, and no others.

    Raises InputError if the shard cannot be read.
    """
    try:
        names = read_index(path).keys()
    except _DamagedShardError:
        return False
    return names == {f"{key}.{suffix}" for key in keys for suffix in SUFFIXES}


def read_index(path: Path) -> dict[str, Location]:
    """Location of each file in a shard, by name.

    Raises InputError if the shard is damaged or cannot be read.
    """
    try:
        with tarfile.open(path, "r:") as tar:
            members = {m.name: Location(path, m.offset_data, m.size) for m in tar}
        end = max((m.offset + m.size for m in members.values()), default=0)
        whole = _ends_as_written(path, end)
    except OSError as error:
        raise unreadable(path, error) from error
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


def unreadable(path: Path, error: OSError) -> InputError:
    """The error for a shard that the system refuses to read."""
    return InputError(f"{path}: cannot be read ({error.strerror}); {rerender([path])}")


def _damaged(path: Path) -> _DamagedShardError:
    return _DamagedShardError(f"{path}: the shard is truncated or damaged; {RENDER}")


def shard_paths(folder: Path) -> list[Path]:
    """The complete shards of a folder, in order. Raises InputError if there is none."""
    paths = sorted(folder.glob("shard-*.tar"))
    if not paths:
        inner = sorted({path.parent.name for path in folder.glob("*/shard-*.tar")})
        remedy = f"name one of its folders: {', '.join(inner)}" if inner else RENDER
        raise InputError(f"{folder}: no shard-*.tar in it; {remedy}")
    return paths
