"""Writing of shards: whole, or not at all.

The bytes of a shard depend on its samples alone: no time stamps, no user names.
"""

import io
import os
import socket
import tarfile
from pathlib import Path

from shaftpose.core.samples import Sample, encode_sample


def shard_name(index: int) -> str:
    """The file name of shard `index`."""
    return f"shard-{index:06d}.tar"


class ShardWriter:
    """Writes one shard under a temporary name; `with` renames it when it is complete.

    A file under the final name is therefore always complete. The temporary name is unique to the
    process; if two processes write the same shard, the last one wins. Temporary files left by dead
    processes of this host are removed.
    """

    def __init__(self, path: Path, jpeg_quality: int) -> None:
        self._path, self._quality = path, jpeg_quality
        self._temporary = path.with_name(f"{_part_prefix(path)}{os.getpid()}.part")

    def __enter__(self) -> "ShardWriter":
        self._path.parent.mkdir(parents=True, exist_ok=True)
        _remove_remains(self._path)
        self._tar = tarfile.open(self._temporary, "w", format=tarfile.USTAR_FORMAT)
        return self

    def __exit__(self, kind: object, value: object, trace: object) -> None:
        try:
            self._tar.close()  # also writes, so it fails on a full disk
            if kind is None:
                _write_through(self._temporary)
                self._temporary.replace(self._path)
        finally:
            self._temporary.unlink(missing_ok=True)

    def write(self, sample: Sample) -> None:
        """Append one sample."""
        for suffix, data in encode_sample(sample, self._quality).items():
            member = tarfile.TarInfo(f"{sample.key}.{suffix}")
            member.size = len(data)
            self._tar.addfile(member, io.BytesIO(data))


def _write_through(path: Path) -> None:
    """Flush a file to disk; otherwise a power loss may leave zeros under its final name."""
    with path.open("rb") as file:
        os.fsync(file.fileno())


def _part_prefix(path: Path) -> str:
    """Prefix of a shard's temporary file names on this host; the process id follows."""
    return f"{path.name}.{socket.gethostname()}."


def _remove_remains(path: Path) -> None:
    prefix = _part_prefix(path)
    for part in path.parent.glob(f"{prefix}*.part"):
        pid = part.name.removeprefix(prefix).removesuffix(".part")
        if pid.isdecimal() and not _is_alive(int(pid)):
            part.unlink(missing_ok=True)


def _is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)  # signal 0 only checks
    except ProcessLookupError:
        return False
    except PermissionError:  # another user's process
        return True
    return True
