"""Where results are written while they come: standard output, or a new file."""

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import TextIOWrapper
from pathlib import Path
from typing import TextIO

from shaftpose.inference.formats import Format
from shaftpose.inference.found_shafts import FoundShaft
from shaftpose.inference.frames import Origin
from shaftpose.inference.unwritable import naming_unwritable

_AS_NAMED = "surrogateescape"  # file names are bytes, not always of UTF-8


class ResultStream:
    """Results as text; whoever reads along sees each frame at once. name: for errors."""

    def __init__(self, stream: TextIO, name: str, style: Format) -> None:
        self._stream, self._name, self._format = stream, name, style
        self._write(style.header)

    def add(self, frame: Origin, shafts: Sequence[FoundShaft]) -> None:
        """Write what was found in a frame.

        Raises InputError if the format cannot hold the frame, UnwritableError if there is no room,
        BrokenPipeError if the reader has gone.
        """
        self._write(self._format.lines(frame, shafts))

    def _write(self, text: str) -> None:
        with naming_unwritable(self._name):
            self._stream.write(text)
            self._stream.flush()


@contextmanager
def result_stream(folder: Path | None, style: Format) -> Iterator[ResultStream]:
    """A stream into a new `predictions` file of a folder, or to standard output if that is None.

    Raises UnwritableError naming the file if it cannot be created or is there already.
    """
    if folder is None:
        if isinstance(sys.stdout, TextIOWrapper):
            sys.stdout.reconfigure(errors=_AS_NAMED)
        yield ResultStream(sys.stdout, "standard output", style)
        return
    path = folder / f"predictions.{style.suffix}"
    with naming_unwritable(path):
        folder.mkdir(parents=True, exist_ok=True)
        stream = path.open("x", encoding="utf-8", errors=_AS_NAMED)
    with stream:
        yield ResultStream(stream, str(path), style)
