"""Figures of whole frames and their aims: the records in reports/whole_frames, and tables."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

from shaftpose.core.errors import InputError
from shaftpose.core.files import write_json
from shaftpose.figures.markdown import pipe_table
from shaftpose.inference.model_files import bundled_model, bundled_names, checksum
from shaftpose.stage_files import read_stage_file

RECORDS = Path("reports/whole_frames")
COMMAND = "python -m studies.whole_frames"
_HEADINGS = ("Frames", "Figure", "Value", "Aim", "", "Measured on", "Seed")


@dataclass(frozen=True)
class Figure:
    """A measured value, None if there was nothing to measure.

    on: what it was measured on, in numbers. least, most: its aim. parts: details behind it.
    """

    name: str
    value: float | None
    on: str
    least: float | None = None
    most: float | None = None
    parts: Mapping[str, float | None] = field(default_factory=dict)

    @property
    def aim(self) -> str:
        """The aim in words; empty without one."""
        if self.least is not None:
            return f">= {self.least:g}"
        return "" if self.most is None else f"<= {self.most:g}"

    @property
    def verdict(self) -> str:
        """Whether the aim is met, in a word; empty without one."""
        if self.least is None and self.most is None:
            return ""
        if self.value is None:
            return "not measured"
        low, high = self.least, self.most
        met = (low is None or self.value >= low) and (high is None or self.value <= high)
        return "met" if met else "missed"


@dataclass(frozen=True)
class RecordedRow:
    """The figures of one kind of frames, and the command and seed that they come from.

    verdicts: those of the figures, for readers of the file.
    """

    title: str
    command: str
    seed: int
    frames: int
    figures: Sequence[Figure]
    verdicts: Sequence[str]


@dataclass(frozen=True)
class Record:
    """The measurements of a model. model: the line of its checksum; machine: of the last run."""

    model: str
    machine: Mapping[str, str | int | float | None]
    rows: Mapping[str, RecordedRow]


def add_rows(path: Path, new: Record) -> None:
    """Write a record; rows that it lacks are kept from an earlier record of the same model."""
    kept: Mapping[str, RecordedRow] = {}
    if path.is_file() and (old := read_record(path)).model == new.model:
        kept = old.rows
    write_json(path, asdict(replace(new, rows={**kept, **new.rows})))


def read_record(path: Path) -> Record:
    """A record. Raises InputError as `read_stage_file` does."""
    return read_stage_file(path, Record, f"remove it, or run `{COMMAND} --model {path.stem}`")


def tables(root: Path) -> dict[str, str]:
    """The tables of the models with a record below `root`, by name.

    Raises InputError if a record is of another model than the bundled one of its name.
    """
    found = {}
    for path in sorted((root / RECORDS).glob("*.json")):
        record, name = read_record(path), path.stem
        if name in bundled_names() and record.model.encode() != checksum(bundled_model(name)):
            raise InputError(
                f"{path}: measured of another model than the bundled one; run "
                f"`{COMMAND} --model {name}`, or remove it"
            )
        found[name] = table(record.rows)
    return found


def table(rows: Mapping[str, RecordedRow]) -> str:
    """The figures of a record as Markdown."""
    return pipe_table(
        _HEADINGS,
        [
            [row.title, one.name, _text(one.value), one.aim, one.verdict, one.on, str(row.seed)]
            for row in rows.values()
            for one in row.figures
        ],
    )


def _text(value: float | None) -> str:
    return "n/a" if value is None else f"{value:.4g}"
