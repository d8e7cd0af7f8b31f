"""Record of one training: its row of Table I, its errors, and its curves."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields
from typing import Any

from shaftpose.errors import InputError
from shaftpose.evaluation.binned_errors import ErrorBin, as_plain, from_plain
from shaftpose.evaluation.common_instruments import FoundInstruments
from shaftpose.report.ablation import VariantRow

# Learning curves, in the order of a figure's panels.
CURVES = tuple(
    f"validation/{name}"
    for name in ("mAP", "detected_rate", "confidence", "box", "pose", "tip_mm", "pitch_deg",
                 "yaw_deg", "axis_deg")
)  # fmt: skip


@dataclass(frozen=True)
class TrainingRecord:
    """One training; `curves` are rows of step, name and value, for the names of `CURVES`; none for
    fitted poses.

    recipe: settings that compared trainings must share: those recorded by the train stage (sizes,
    camera, ranges of poses, loss, training) and those of detection. variant: settings that
    trainings of one variant must also share. data: digest of the rendered images and their split.
    real: `domain`, number `images` and `digest` of the real training images; None without any.
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
        """Plain values, ready for JSON; the inverse of `read_record`."""
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
    """The rows of step, name and value that a record keeps, grouped by name."""
    return [
        (int(step), str(name), float(value))
        for wanted in CURVES
        for step, name, value in curves
        if name == wanted
    ]


def read_record(content: Mapping[str, Any], file: str) -> TrainingRecord:
    """The inverse of `as_plain`; `file`: the record's path, for messages.

    Raises InputError if a part is missing.
    """
    with whole(file, "record the training again with `python -m studies.evaluate_trainings`"):
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
    """Raise InputError, naming the file and the remedy, if a key read in the block is missing."""
    try:
        yield
    except (KeyError, TypeError) as error:
        raise InputError(f"{file}: of another version, or damaged ({error}); {remedy}") from error


def read_row(content: Mapping[str, Any]) -> VariantRow:
    """A row of Table I from plain values, without the fields that ablation.json adds."""
    names = {field.name for field in fields(VariantRow)} & content.keys()
    return VariantRow(**{n: content[n] for n in names} | {"seeds": tuple(content["seeds"])})
