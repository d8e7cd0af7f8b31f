"""The results of an interrupted run, which another run continues."""

import csv
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import takewhile
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from shaftpose.core.errors import InputError
from shaftpose.frame_sources.frames import ImageFile, Source
from shaftpose.frame_sources.video_files import VideoFile
from shaftpose.frame_sources.web_addresses import WebAddress
from shaftpose.inference.formats import CSV_COLUMNS
from shaftpose.inference.result_stream import AS_NAMED, hold, naming_unwritable
from shaftpose.inference.tracker import film_of


class Row(NamedTuple):
    """A frame's results, and where they begin in the file."""

    source: str
    number: int
    time_s: float | None
    start: int


@dataclass(frozen=True)
class Earlier:
    """The frames that an interrupted run has finished.

    frames: for each source, the number of the first frame still to do, once for each time that the
    source was named. again: the sources whose results were dropped, because a part of them may be
    missing. count: of the frames with results.
    """

    frames: Mapping[str, Sequence[int]]
    again: frozenset[str] = frozenset()
    count: int = 0

    def rest(self, sources: Iterable[Source]) -> Iterator[Source]:
        """The sources that are left, of a film with its next frame. Streams begin again."""
        known = {name: iter(done) for name, done in self.frames.items()}
        for source in sources:
            done = next(known.get(source.name, iter(())), 0)
            if done and isinstance(source, VideoFile | WebAddress):
                yield replace(source, first=done)
            elif not done or not isinstance(source, ImageFile):
                yield source


def continued(path: Path, style: str, tracked: bool, drawn: bool) -> Earlier:
    """Remove the end of a file of results, which may be unfinished: its last frame, or its last
    film if that is tracked or drawn, which needs all frames. Nothing is done if there is no file.

    style: `jsonl` or `csv`. tracked: whether shafts are tracked, so that the images of a folder are
    a film. Raises InputError naming the file if it cannot be read, or another run writes to it.
    """
    if not path.exists():
        return Earlier({})
    with naming_unwritable(path), path.open("rb+") as file:
        hold(file, path)
        rows: list[Row] = []
        try:
            for row in _READERS[style](file):
                rows.append(row)  # noqa: PERF402 not `extend`: the error tells how far it came
        except (ValueError, KeyError, TypeError, csv.Error) as error:
            place, part = (f"after {len(rows)} frames, ", " from there on") if rows else ("", "")
            raise InputError(
                f"{path}: {place}holds no results of --format {style}; remove it{part}"
            ) from error
        kept = _kept(rows, tracked, drawn)
        file.truncate(rows[len(kept)].start if rows else 0)
    again = frozenset(row.source for row in rows[len(kept) :])
    return Earlier(_next_frames(kept), again, len(kept))


def _kept(rows: list[Row], tracked: bool, drawn: bool) -> list[Row]:
    """The rows before the last frame or film."""

    def unit(row: Row) -> object:
        if tracked or (drawn and row.time_s is not None):
            return film_of(row)
        return row.source, row.number

    dropped = sum(1 for _ in takewhile(lambda row: unit(row) == unit(rows[-1]), reversed(rows)))
    return rows[: len(rows) - dropped]


def _next_frames(rows: Sequence[Row]) -> dict[str, list[int]]:
    """See `Earlier.frames`. A number that does not grow means that the source was named again."""
    found: dict[str, list[int]] = {}
    for row in rows:
        done = found.setdefault(row.source, [])
        if done and row.number >= done[-1]:
            done[-1] = row.number + 1
        else:
            done.append(row.number + 1)
    return found


def _json_rows(file: BinaryIO) -> Iterator[Row]:
    """The complete lines."""
    start = 0
    for line in file:
        if not line.endswith(b"\n"):
            return
        found: dict[str, Any] = json.loads(line)
        yield Row(found["image"], found["frame"], found["time_s"], start)
        start += len(line)


def _csv_rows(file: BinaryIO) -> Iterator[Row]:
    """The frames of the complete rows after the heading, one row for each shaft; names may hold
    line feeds."""
    start, end, last = 0, 0, ("", -1)

    def lines() -> Iterator[str]:
        nonlocal end
        for line in file:
            if line.endswith(b"\n"):
                end += len(line)
                yield line.decode(errors=AS_NAMED)

    rows = csv.reader(lines())
    for found in rows:
        if start == 0 and found != list(CSV_COLUMNS):
            raise ValueError("another heading")
        if len(found) < len(CSV_COLUMNS):
            if next(rows, None) is not None:
                raise ValueError("a row in between is too short")
            return  # the last name was cut
        if start:
            name, number = found[0].removeprefix("./"), int(found[1])  # no `Path` begins with ./
            if (name, number) != last:
                yield Row(name, number, float(found[2]) if found[2] else None, start)
            last = name, number
        start = end


_READERS: dict[str, Callable[[BinaryIO], Iterator[Row]]] = {"jsonl": _json_rows, "csv": _csv_rows}
