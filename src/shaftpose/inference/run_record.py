"""The record of a run, for `--resume`: its options, and the videos that it has drawn."""

import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from shaftpose.core.errors import InputError
from shaftpose.core.files import read_json, write_json
from shaftpose.inference.result_stream import naming_unwritable

_REMEDY = "name another folder by --out, or remove the results"


@dataclass(frozen=True)
class _Content:
    """options: those that results depend on, by name. videos: names of drawings, each with its
    source."""

    options: dict[str, str]
    videos: tuple[tuple[str, str], ...] = ()


class RunRecord:
    """The record of a run, a file next to its results."""

    def __init__(self, path: Path, content: _Content) -> None:
        self._path, self._content = path, content

    @property
    def videos(self) -> tuple[tuple[str, str], ...]:
        """The names of the videos that the run has drawn so far, each with its source."""
        return self._content.videos

    def add_video(self, name: str, source: str) -> None:
        """Note a video before it is drawn. Raises UnwritableError naming the record."""
        if (name, source) not in self.videos:
            self._content = _Content(self._content.options, (*self.videos, (name, source)))
            self.write()

    def write(self) -> None:
        """Write the file. Raises UnwritableError naming it."""
        with naming_unwritable(self._path):
            write_json(self._path, asdict(self._content))


def run_record(results: Path, options: Mapping[str, str], resumed: bool) -> RunRecord:
    """The record of a run that writes to `results`; a resumed run gets the earlier run's record.

    Raises InputError naming the results if they have no record, or if an option was another one
    when they were begun.
    """
    path = results.with_name(f"{results.name}.options")
    record = RunRecord(path, _Content(dict(options)))
    if not os.path.lexists(results):
        record.write()
    elif resumed:
        if not path.is_file():
            raise InputError(
                f"{results}: {path.name}, which tells its options, is missing; {_REMEDY}"
            )
        known = _read(path)
        for name, value in options.items():
            if known.options.get(name) != value:
                raise InputError(
                    f"{results}: was begun with {name} {known.options.get(name)}, not {value}; "
                    f"give the same again, or {_REMEDY}"
                )
        record = RunRecord(path, known)
    return record


def _read(path: Path) -> _Content:
    """Raises InputError naming the file if it is damaged."""
    try:
        found = read_json(path, _REMEDY)
        videos = tuple((str(name), str(source)) for name, source in found["videos"])
        return _Content(dict(found["options"]), videos)
    except (TypeError, KeyError, ValueError) as error:
        raise InputError(f"{path}: damaged; {_REMEDY}") from error
