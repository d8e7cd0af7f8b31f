"""A lock against a second run in the same folder."""

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from shaftpose.core.errors import InputError


@contextmanager
def alone_in(folder: Path, scratch: Path) -> Iterator[None]:
    """Hold the lock of a folder during the block; the system releases it even after a crash.

    scratch: where the lock's file lies, named after the folder; in the folder itself, DVC would
    treat it as a result. Raises InputError if another run holds the lock.
    """
    scratch.mkdir(parents=True, exist_ok=True)
    name = hashlib.sha256(str(folder.resolve()).encode()).hexdigest()[:16]
    lock = FileLock(scratch / f"{name}.lock")
    try:
        lock.acquire(timeout=0)
    except Timeout as error:
        raise InputError(
            f"{folder}: another run is writing to this folder; wait for it to end"
        ) from error
    try:
        yield
    finally:
        lock.release()
