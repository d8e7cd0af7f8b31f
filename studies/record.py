"""Record of one training: its row of Table I, its errors, and its curves."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from shaftpose.metrics.binned_errors import ErrorBin
from shaftpose.metrics.pose_errors import FoundInstruments
from shaftpose.report.ablation import VariantRow
from shaftpose.stage_files import MixedInImages, read_stage_file

# Learning curves, in the order of a figure's panels.
CURVES = tuple(
    f"validation/{name}"
    for name in ("mAP", "detected_rate", "confidence", "box", "pose", "tip_mm", "pitch_deg",
                 "yaw_deg", "axis_deg")
)  # fmt: skip


@dataclass(frozen=True)
class EvaluatedTraining:
    """One training; `curves` are rows of step, name and value, for the names of `CURVES`; none for
    refined poses.

    recipe: settings that compared trainings must share: those recorded by the train stage (sizes,
    camera, ranges of poses, loss, training) and those of detection. variant: settings that
    trainings of one variant must also share. data: digest of the rendered images and their split.
    mixed_in: None for a training on rendered images alone.
    """

    row: VariantRow
    recipe: Mapping[str, Any]
    variant: Mapping[str, Any]
    data: str
    mixed_in: MixedInImages | None
    binned_errors: Mapping[str, Sequence[ErrorBin]]
    found: FoundInstruments
    curves: Sequence[tuple[int, str, float]]


def validation_curves(curves: Sequence[tuple[int, str, float]]) -> list[tuple[int, str, float]]:
    """The rows of step, name and value that a record keeps, grouped by name."""
    return [row for wanted in CURVES for row in curves if row[1] == wanted]


def read_record(path: Path) -> EvaluatedTraining:
    """A record from its file. Raises InputError as `read_stage_file` does."""
    remedy = "record the training again with `python -m studies.evaluate_trainings`"
    return read_stage_file(path, EvaluatedTraining, remedy)
