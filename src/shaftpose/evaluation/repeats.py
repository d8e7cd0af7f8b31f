"""Several trainings of one variant as one row: mean and half range."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from shaftpose.config import LossSettings
from shaftpose.evaluation.ablation import VariantRow
from shaftpose.evaluation.training_record import TrainingRecord


class Scale(NamedTuple):
    """What trainings must agree in to compare."""

    training_images: int
    steps: int
    batch_size: int
    width: float
    loss: LossSettings

    def sentence(self) -> str:
        """The scale for readers."""
        loss, beta = self.loss, ", ".join(f"{weight:g}" for weight in self.loss.beta)
        return (
            f"{self.training_images:,} training images, {self.steps:,} steps of {self.batch_size}, "
            f"width {self.width:g}; loss weights alpha {loss.alpha:g}, gamma {loss.gamma:g}, "
            f"beta {beta}."
        )

    def file_name(self) -> str:
        """The scale as a part of a file's name."""
        loss, beta = self.loss, "-".join(f"{weight:g}" for weight in self.loss.beta)
        return (
            f"{self.training_images}_images_{self.steps}x{self.batch_size}_width_{self.width:g}"
            f"_alpha_{loss.alpha:g}_gamma_{loss.gamma:g}_beta_{beta}"
        )


def by_scale(records: Sequence[TrainingRecord]) -> dict[Scale, list[TrainingRecord]]:
    """The trainings of each scale, in the order in which they come.

    Of trainings with the same variant, scale and seed the first one counts.
    """
    found: dict[Scale, dict[tuple[str, tuple[int, ...]], TrainingRecord]] = {}
    for record in records:
        row = record.row
        scale = Scale(row.training_images, row.steps, row.batch_size, row.width, record.loss)
        found.setdefault(scale, {}).setdefault((row.variant, row.seeds), record)
    return {scale: list(trained.values()) for scale, trained in found.items()}


def rows_of(records: Sequence[TrainingRecord]) -> list[VariantRow]:
    """One row for each variant of trainings of one scale, in the order in which they come first."""
    found: dict[str, list[VariantRow]] = {}
    for record in records:
        found.setdefault(record.row.variant, []).append(record.row)
    return [repeated(rows) for rows in found.values()]


def repeated(rows: Sequence[VariantRow]) -> VariantRow:
    """Trainings of one variant, with a seed each, as one row.

    The mean of each metric and, as `spread`, half of its range; None if one training lacks it. A
    single training stays as it is.
    """
    if len(rows) == 1:
        return rows[0]
    metrics: dict[str, float | int | None] = {}
    spread: dict[str, float | int | None] = {}
    for name in rows[0].metrics:
        values = [value for row in rows if (value := row.metrics.get(name)) is not None]
        complete = len(values) == len(rows)
        metrics[name] = float(np.mean(values)) if complete else None
        if complete:
            spread[name] = float(np.ptp(values)) / 2
    seeds = tuple(seed for row in rows for seed in row.seeds)
    return replace(rows[0], metrics=metrics, spread=spread, seeds=seeds)
