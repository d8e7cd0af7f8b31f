"""Several trainings of one variant as one row: mean and half range."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from shaftpose.core.errors import InputError
from shaftpose.metrics.table import MetricValues
from shaftpose.report.ablation import VariantRow
from shaftpose.settings.parsing import flatten
from studies.record import EvaluatedTraining

INTERVAL = ("iou_low", "iou_high")  # of silhouettes, over the images of one training


class Scale(NamedTuple):
    """The properties that comparable trainings share. `data`: digest of the rendered images and
    their split; `steps`: steps taken; `settings`: recipe as JSON, including the planned steps."""

    training_images: int
    test_images: int
    data: str
    steps: int
    settings: str

    @property
    def recipe(self) -> dict[str, Any]:
        """The settings by their names in the configuration."""
        return dict(json.loads(self.settings))

    def sentence(self) -> str:
        """The scale as a sentence."""
        size, loss, training = (self.recipe[part] for part in ("size", "loss", "training"))
        planned = "" if self.steps == size["steps"] else f" of {size['steps']:,} planned"
        frozen = max(0.0, 1 - size["steps"] * (1 - training["frozen_norm_share"]) / self.steps)
        return (
            f"{self.training_images:,} training images, {self.test_images:,} test images; "
            f"{self.steps:,}{planned} steps of {size['batch_size']} images at width "
            f"{size['width']:g}, depth {size['depth']:g}, optimiser "
            f"{size['optimizer'].capitalize()}, precision {size['precision']}, "
            f"learning rate {size['learning_rate']:g}, batch normalisation frozen in the last "
            f"{frozen:.0%}; loss weights alpha {loss['alpha']:g}, gamma {loss['gamma']:g}, "
            f"beta {', '.join(f'{weight:g}' for weight in loss['beta'])}."
        )

    def file_name(self) -> str:
        """The scale as part of a file name, which ends with a digest of all fields."""
        size, steps = self.recipe["size"], f"{self.steps}x{self.recipe['size']['batch_size']}"
        digest = hashlib.sha256(json.dumps(self).encode()).hexdigest()[:8]
        shape = f"width_{size['width']:g}_depth_{size['depth']:g}"
        return f"{self.training_images}_images_{steps}_{shape}_{digest}"


def distinctions(scales: Sequence[Scale]) -> dict[str, list[Any]]:
    """The settings that differ, such as `training.ema_decay`: name -> value in each scale.

    Of settings with one name (`size.steps` and the steps taken) and equal values, only the first.
    """
    flat = [flatten({**scale._asdict(), "settings": scale.recipe}) for scale in scales]
    names = list(dict.fromkeys(name for one in flat for name in one))
    values = {name: [one.get(name) for one in flat] for name in names}
    seen, differing = set[str](), dict[str, list[Any]]()
    for name in names:
        known = f"{name.rpartition('.')[2]} {values[name]}"
        if known not in seen and any(value != values[name][0] for value in values[name]):
            differing[name.removeprefix("settings.")] = values[name]
        seen.add(known)
    return differing


def by_scale(records: Sequence[EvaluatedTraining]) -> dict[Scale, list[EvaluatedTraining]]:
    """The trainings of each scale, in the given order.

    Raises InputError if, within a scale, two trainings share variant and seed, the settings of a
    variant differ, two variants share a title, or the real images differ.
    """
    found: dict[Scale, dict[tuple[str, bool, tuple[int, ...]], EvaluatedTraining]] = {}
    for record in records:
        row, settings = record.row, json.dumps(record.recipe, sort_keys=True)
        images = (row.training_images, row.test_images, record.data)
        scale = Scale(*images, row.steps, settings)
        alike = found.setdefault(scale, {})
        if (row.variant, row.refined, row.seeds) in alike:
            raise InputError(
                f"reports/trainings/{row.variant}-{row.seeds[0]}-*.json: two records with the same "
                "settings; delete one of them"
            )
        alike[row.variant, row.refined, row.seeds] = record
    scales = {scale: list(alike.values()) for scale, alike in found.items()}
    for trainings in scales.values():
        _check_alike(trainings)
    return scales


def _check_alike(records: Sequence[EvaluatedTraining]) -> None:
    """Raise InputError unless, at one scale, trainings of one variant have equal settings, variants
    have titles of their own, and trainings with mixed-in images share these."""
    for one, other in combinations(records, 2):
        pair = " and ".join(
            f"reports/trainings/{record.row.variant}-{record.row.seeds[0]}-*.json"
            for record in (one, other)
        )
        if one.row.variant == other.row.variant and one.variant != other.variant:
            raise InputError(
                f"{pair}: trained with different settings of the variant ({one.variant} and "
                f"{other.variant}); delete one, or train it as a separate variant"
            )
        if one.row.variant != other.row.variant and one.row.title == other.row.title:
            raise InputError(
                f"{pair}: two variants with the title {one.row.title!r}; change one title in "
                "conf/variant/ and record it again"
            )
        if one.mixed_in and other.mixed_in and one.mixed_in != other.mixed_in:
            raise InputError(
                f"{pair}: trained with different images mixed in ({one.mixed_in} and "
                f"{other.mixed_in}); delete one"
            )


def rows_of(records: Sequence[EvaluatedTraining]) -> list[VariantRow]:
    """One row for each variant in trainings of one scale, in order of first occurrence."""
    found: dict[tuple[str, bool], list[VariantRow]] = {}
    for record in records:
        found.setdefault((record.row.variant, record.row.refined), []).append(record.row)
    return [repeated(rows) for rows in found.values()]


def repeated(rows: Sequence[VariantRow]) -> VariantRow:
    """Trainings of one variant with different seeds, as one row.

    It has the mean of each metric, or None if a training lacks it, and half the range as `spread`,
    the means of silhouettes that all trainings have, without intervals, and nothing that belongs to
    a single training. A single training is unchanged.
    """
    if len(rows) == 1:
        return rows[0]
    known = _known_to_all([row.metrics for row in rows])
    silhouettes = {
        images: _means(_known_to_all([row.silhouettes.get(images, {}) for row in rows]))
        for images in rows[0].silhouettes
    }
    return replace(
        rows[0],
        metrics=dict.fromkeys(rows[0].metrics) | _means(known),
        spread={name: float(np.ptp(values)) / 2 for name, values in known.items()},
        seeds=tuple(seed for row in rows for seed in row.seeds),
        silhouettes={
            images: {name: mean for name, mean in means.items() if name not in INTERVAL}
            for images, means in silhouettes.items()
            if means
        },
        summary=None, depths=(), training_id="", origin=None,
    )  # fmt: skip


def _known_to_all(rows: Sequence[MetricValues]) -> dict[str, list[float]]:
    values = {name: [row.get(name) for row in rows] for name in rows[0]}
    return {name: [float(v) for v in of_all if v is not None] for name, of_all in values.items()
            if None not in of_all}  # fmt: skip


def _means(values: Mapping[str, Sequence[float]]) -> dict[str, float | int | None]:
    return {name: float(np.mean(of_all)) for name, of_all in values.items()}
