"""What is kept of one training: its line of Table I, its errors, and its curves."""

from collections.abc import Mapping, Sequence
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

    recipe: all settings but variant and seed, as the train stage notes them.
    """

    row: VariantRow
    recipe: Mapping[str, Any]
    binned_errors: Mapping[str, Sequence[ErrorBin]]
    found: FoundInstruments
    curves: Sequence[tuple[int, str, float]]

    def as_plain(self) -> dict[str, Any]:
        """Plain values, ready for JSON; `read_record` is the way back."""
        return {
            "row": asdict(self.row),
            "recipe": self.recipe,
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


def read_record(content: Mapping[str, Any], file: str) -> TrainingRecord:
    """What `as_plain` was made of; `file` is where it lies, for messages."""
    return TrainingRecord(
        row=read_row(content["row"]),
        recipe=read_recipe(content, file),
        binned_errors=from_plain(content["binned_errors"]),
        found=FoundInstruments(**content["found"]),
        curves=validation_curves(content["curves"]),
    )


def read_recipe(content: Mapping[str, Any], file: str) -> dict[str, Any]:
    """The settings of a training. Raises InputError if `file` does not say them."""
    if "recipe" not in content:
        raise InputError(f"{file}: lacks `recipe`, the settings of the training; train it again")
    return dict(content["recipe"])


def read_row(content: Mapping[str, Any]) -> VariantRow:
    """A line of Table I from plain values, less what ablation.json adds to it."""
    names = {field.name for field in fields(VariantRow)} & content.keys()
    return VariantRow(**{n: content[n] for n in names} | {"seeds": tuple(content["seeds"])})
