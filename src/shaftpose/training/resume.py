"""The folder of an unfinished training's state, from which it can be resumed."""

import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import AcquireReturnProxy, FileLock, Timeout

from shaftpose.core.errors import InputError
from shaftpose.core.files import new_file

LAST_CHECKPOINT = "last.ckpt"

# The data loaders of a killed training hold its lock until they exit, within seconds.
_PATIENCE_S = 30.0


@contextmanager
def locked_training_folder(folder: Path) -> Iterator[str]:
    """Hold the lock of a training whose state and result are in `folder`.

    Yields the training's id, which stays the same after a resume. Removes the last checkpoint when
    the training is finished. Raises InputError if another process runs the same training.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    with _held(folder.with_suffix(".lock")):
        folder.mkdir(exist_ok=True)
        yield _training_id(folder / "training_id")
        (folder / LAST_CHECKPOINT).unlink(missing_ok=True)


def _held(path: Path) -> AcquireReturnProxy:
    try:
        return FileLock(path).acquire(timeout=_PATIENCE_S)
    except Timeout as error:
        raise InputError(
            f"{path}: another process trains with these settings; wait for it or stop it"
        ) from error


def _training_id(note: Path) -> str:
    if not note.is_file():
        with new_file(note) as part:
            part.write_text(uuid.uuid4().hex)
    return note.read_text()
