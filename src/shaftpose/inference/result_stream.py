"""Results as text, and the errors of outputs that cannot be written."""

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from io import TextIOWrapper
from pathlib import Path
from typing import IO, Any, TextIO

from shaftpose.core.errors import InputError, printable
from shaftpose.frame_sources.frames import FrameId
from shaftpose.inference.formats import Format
from shaftpose.inference.found_shafts import FoundShaft


class UnwritableError(InputError):
    """An output cannot be written, which ends the run: all later results would be lost, too."""


def incomplete(path: object) -> UnwritableError:
    """The error of a file that lacks frames although its writer has reported no failure."""
    return UnwritableError(
        f"{path}: not complete; name another folder by --out, on a disk with room; the other "
        "results are kept"
    )


@contextmanager
def naming_unwritable(path: object) -> Iterator[None]:
    """Turn an OSError into an UnwritableError naming the file. A BrokenPipeError is passed on: the
    reader of the pipe needs no more results."""
    try:
        yield
    except BrokenPipeError:
        raise
    except FileExistsError as error:
        raise UnwritableError(
            f"{error.filename}: is there already, and is kept; name another folder by --out"
        ) from error
    except OSError as error:
        raise UnwritableError(
            f"{path}: cannot be written ({error.strerror}); name another folder by --out, on a "
            "disk with room; earlier results are kept"
        ) from error


def hold(file: IO[Any], path: object) -> None:
    """Hold a file until it is closed. Raises UnwritableError naming it if another run holds it."""
    try:
        import fcntl
    except ImportError:  # on Windows
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise UnwritableError(
            f"{path}: another run is writing to this file; wait for it to end"
        ) from error
    except OSError:  # a disk without locks
        return


AS_NAMED = "surrogateescape"  # file names may be bytes that are not UTF-8


class ResultStream:
    """Writes results as text and flushes after every frame.

    name: of the file, for errors. begun: whether it has a heading already.
    """

    def __init__(self, stream: TextIO, name: str, style: Format, begun: bool = False) -> None:
        self._stream, self._name, self._format = stream, name, style
        if not begun:
            self._write(style.header)

    def add(self, frame: FrameId, shafts: Sequence[FoundShaft]) -> None:
        """Write the shafts of a frame.

        Raises InputError if the format cannot represent the frame, UnwritableError if the disk is
        full, BrokenPipeError if the reader has closed the pipe.
        """
        self._write(self._format.lines(frame, shafts))

    def _write(self, text: str) -> None:
        with naming_unwritable(self._name):
            self._stream.write(text)
            self._stream.flush()


@contextmanager
def result_stream(
    folder: Path | None, style: Format, resumed: bool = False
) -> Iterator[ResultStream]:
    """Open a new file `predictions` in a folder, or standard output if that is None.

    resumed: whether an earlier file is continued. Raises UnwritableError naming the file if it
    exists already, cannot be created, or another run writes to it.
    """
    if folder is None:
        if sys.stdout is None:
            raise UnwritableError("standard output is closed; name a folder by --out")
        if isinstance(sys.stdout, TextIOWrapper):
            sys.stdout.reconfigure(errors=AS_NAMED)
        shown = replace(style, lines=_for_terminals(style)) if sys.stdout.isatty() else style
        yield ResultStream(sys.stdout, "standard output", shown)
        return
    path = results_file(folder, style)
    with naming_unwritable(path):
        folder.mkdir(parents=True, exist_ok=True)
        stream = path.open("a" if resumed else "x", encoding="utf-8", errors=AS_NAMED)
    try:
        hold(stream, path)
        yield ResultStream(stream, str(path), style, path.stat().st_size > 0)
    finally:
        with suppress(OSError):  # the last write has named it
            stream.close()


def _for_terminals(style: Format) -> Callable[[FrameId, Sequence[FoundShaft]], str]:
    def lines(frame: FrameId, shafts: Sequence[FoundShaft]) -> str:
        return "\n".join(map(printable, style.lines(frame, shafts).split("\n")))

    return lines


def results_file(folder: Path, style: Format) -> Path:
    """The file of a run's results."""
    return folder / f"predictions.{style.suffix}"
