"""Several trainings of one variant as one row: mean and half range."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from shaftpose.evaluation.ablation import VariantRow

Scale = tuple[int, int, int, float]


def scale(row: VariantRow) -> Scale:
    """Training images, steps, batch size and width: rows that differ in them do not compare."""
    return row.training_images, row.steps, row.batch_size, row.width


def by_scale(rows: Sequence[VariantRow]) -> dict[Scale, list[VariantRow]]:
    """One row for each variant of each scale, in the order in which they come first.

    Of trainings with the same variant, scale and seed the first one counts.
    """
    found: dict[Scale, dict[str, dict[tuple[int, ...], VariantRow]]] = {}
    for row in rows:
        found.setdefault(scale(row), {}).setdefault(row.variant, {}).setdefault(row.seeds, row)
    return {
        key: [repeated(list(trained.values())) for trained in variants.values()]
        for key, variants in found.items()
    }


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
