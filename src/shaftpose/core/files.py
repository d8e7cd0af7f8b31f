"""Files: atomic writes, small CSV and JSON files, errors of the disk, and hidden output."""

import csv
import errno
import json
import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path
from typing import Any

from shaftpose.core.errors import InputError


@contextmanager
def new_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path, a new file, that replaces `path` on success; create its folder if
    needed.

    An existing file is replaced, not written to: it may be a hard link into DVC's cache, which must
    not change.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    part = _new_part(path)
    try:
        yield part
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def _new_part(path: Path) -> Path:
    """Create the first of NAME.part, NAME.2.part, ... that does not exist: others may be the
    user's, another process's, or what a killed one has left."""
    for number in count(1):
        part = path.with_name(f"{path.name}{f'.{number}' if number > 1 else ''}.part")
        with suppress(FileExistsError):
            part.touch(exist_ok=False)
            break
    return part


def write_csv(path: Path, headings: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write a table atomically; create its folder if needed."""
    with new_file(path) as part, part.open("w", newline="", encoding="utf-8") as stream:
        table = csv.writer(stream, lineterminator="\n")
        table.writerow(headings)
        table.writerows(rows)


def write_json(path: Path, content: Any) -> None:
    """Write `content` atomically; create the folder if needed."""
    with new_file(path) as part:
        part.write_text(json.dumps(content, indent=1) + "\n")


def read_json(path: Path, remedy: str) -> Any:
    """Read a JSON file. Raises InputError naming it and the remedy if it cannot be read."""
    try:
        return json.loads(path.read_text())
    except FileNotFoundError as error:
        raise InputError(f"{path}: missing; {remedy}") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); {remedy}") from error
    except ValueError as error:
        raise InputError(f"{path}: cannot be read as JSON ({error}); {remedy}") from error


@contextmanager
def naming_refusal(path: Path, remedy: str) -> Iterator[None]:
    """Turn the system's refusal to write to a path into an InputError naming it and the remedy."""
    try:
        yield
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror}); {remedy}") from error


@contextmanager
def naming_full_disk(folder: Path) -> Iterator[None]:
    """Turn the error of a full disk or an exhausted quota into an InputError naming `folder`."""
    try:
        yield
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        raise InputError(
            f"{folder}: {error.strerror}; make room there and run the command again: finished "
            "shards are kept"
        ) from error


@contextmanager
def output_hidden(descriptor: int) -> Iterator[None]:
    """Silence what libraries write to standard output (1) or standard error (2), past Python."""
    try:
        original = os.dup(descriptor)
    except OSError:  # it is closed
        yield
        return
    with open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), descriptor)
        try:
            yield
        finally:
            os.dup2(original, descriptor)
            os.close(original)
