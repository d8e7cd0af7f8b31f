"""What is kept of one training: its line of Table I, its errors, and its curves."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields
from typing import Any

from shaftpose.errors import InputError
from shaftpose.evaluation.ablation import VariantRow
from shaftpose.evaluation.binned_errors import ErrorBin, as_plain, from_plain
from shaftpose.evaluation.common_instruments import FoundInstruments

# What learning looked like, in the order of a figure's panels.
CURVES = tuple(
    f"validation/{name}"
    for name in ("mAP", "detected_rate", "confidence", "box", "pose", "tip_mm", "pitch_deg",
                 "yaw_deg", "axis_deg")
)  # fmt: skip


@dataclass(frozen=True)
class TrainingRecord:
    """One training; `curves` are rows of step, name and value, for the names of `CURVES`.

    recipe: the settings in which trainings that are compared must agree: those that the train stage
    notes, sizes, backbone, loss, ranges of poses, training, and those of detection. variant: the
    settings in which those of one variant must agree, too. data: a digest of the rendered images
    and their split. real: the real images that it was trained on: their `domain`, the number
    `images` and a `digest`; None if there were none.
    """

    row: VariantRow
    recipe: Mapping[str, Any]
    variant: Mapping[str, Any]
    data: str
    real: Mapping[str, Any] | None
    binned_errors: Mapping[str, Sequence[ErrorBin]]
    found: FoundInstruments
    curves: Sequence[tuple[int, str, float]]

    def as_plain(self) -> dict[str, Any]:
        """Plain values, ready for JSON; `read_record` is the way back."""
        return {
            "row": asdict(self.row),
            "recipe": self.recipe,
            "variant": self.variant,
            "data": self.data,
            "real": self.real,
            "binned_errors": as_plain(self.binned_errors),
            "found": asdict(self.found),
            "curves": [list(line) for line in self.curves],
        }


def validation_curves(curves: Sequence[Sequence[Any]]) -> list[tuple[int, str, float]]:
    """Of all rows of step, name, value those that a record keeps, name by name."""
    return [
        (int(step), str(name), float(value))
        for wanted in CURVES
        for step, name, value in curves
        if name == wanted
    ]


def last_validation(curves: Sequence[Sequence[Any]]) -> dict[str, float]:
    """The metrics of a training's last validation, from rows of step, name, value."""
    phase = "validation/"
    rows = [(step, name, value) for step, name, value in curves if name.startswith(phase)]
    last = max((step for step, _, _ in rows), default=None)
    return {name.removeprefix(phase): value for step, name, value in rows if step == last}


def read_record(content: Mapping[str, Any], file: str) -> TrainingRecord:
    """What `as_plain` was made of; `file` is where it lies, for messages.

    Raises InputError if it lacks a part.
    """
    with whole(file, "record the training again with `tools/evaluate_trainings.py`"):
        return TrainingRecord(
            row=read_row(content["row"]),
            recipe=content["recipe"],
            variant=content["variant"],
            data=content["data"],
            real=content["real"],
            binned_errors=from_plain(content["binned_errors"]),
            found=FoundInstruments(**content["found"]),
            curves=validation_curves(content["curves"]),
        )


@contextmanager
def whole(file: str, remedy: str) -> Iterator[None]:
    """Raises InputError, naming the file and the remedy, if what is read inside lacks a part."""
    try:
        yield
    except (KeyError, TypeError) as error:
        raise InputError(f"{file}: of another version, or damaged ({error}); {remedy}") from error


def read_row(content: Mapping[str, Any]) -> VariantRow:
    """A line of Table I from plain values, less what ablation.json adds to it."""
    names = {field.name for field in fields(VariantRow)} & content.keys()
    return VariantRow(**{n: content[n] for n in names} | {"seeds": tuple(content["seeds"])})
