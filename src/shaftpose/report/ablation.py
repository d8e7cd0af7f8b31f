"""Plain data of an ablation study: training settings, amounts of data and metrics."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from shaftpose.core.errors import InputError
from shaftpose.evaluation.results import Evaluation
from shaftpose.metrics.binned_errors import ErrorBin
from shaftpose.metrics.summary import Summary
from shaftpose.origin import Origin
from shaftpose.report.paper_numbers import TABLE_I

STAND_IN = "stand-in"
FIT = "+fit"  # ends the names of rows of fitted poses
REAL = "real"

MetricValues = Mapping[str, float | int | None]


@dataclass(frozen=True)
class VariantRow:
    """One variant, trained once or several times with different seeds.

    `metrics` are those of `Metrics.as_dict()`, means over `seeds`; `spread` is half the range of
    each, empty for a single training. `width` and `depth` multiply the backbone's channels and
    blocks, None for a network without the paper's backbone; `detector_steps` are the steps of the
    detector that training started from, 0 for random weights; `parameters` is the number of
    weights. `mixed_in_images` are real or stand-in training images in addition to
    `training_images`. Only variants that the paper lacks need a `title`. `summary` is None for
    means of several trainings, and in results of older versions. `depths` are the bins of the true
    depth, none in results of older versions. `training_id`: as in MLflow; `data`: digests of the
    rendered images with their split and of the real images, if any were mixed in; `origin`: of the
    evaluation. Results of older versions lack these three.
    """

    variant: str
    metrics: MetricValues
    training_images: int
    test_images: int
    steps: int
    batch_size: int
    width: float | None
    depth: float | None
    optimizer: str
    detector_steps: int
    seeds: tuple[int, ...]
    parameters: int
    mixed_in_images: int = 0
    title: str = ""
    spread: MetricValues = field(default_factory=dict)
    summary: Summary | None = None
    depths: tuple[ErrorBin, ...] = ()
    training_id: str = ""
    data: tuple[str, ...] = ()
    origin: Origin | None = None


@dataclass(frozen=True)
class Champion:
    """The row of the variant chosen for deployment, and the selection rule as one sentence."""

    variant: str
    rule: str

    @property
    def trained(self) -> str:
        """The variant that was trained."""
        return self.variant.removesuffix(FIT)


@dataclass(frozen=True)
class AblationReport:
    """The content of the report.

    `profile`: the run's profile in conf/profiles.yaml. `constant`: metrics of the constant
    predictor. `domain_label`: kind of the "real" images in this study, `stand-in` or `real`.
    `silhouette`: fields of a `SilhouetteScore` by variant and set of images (`rendered/clear`,
    `rendered/occluded`, and both for the domain, such as `stand-in/clear`). `figures`: PNG files by
    title.
    """

    rows: list[VariantRow]
    constant: MetricValues
    silhouette: Mapping[str, Mapping[str, MetricValues]]
    domain_label: str
    champion: Champion
    profile: str
    figures: Mapping[str, Path] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.domain_label not in (STAND_IN, REAL):
            raise InputError(
                f"domain_label is {self.domain_label!r}: use {STAND_IN!r} or {REAL!r}, so that "
                "readers know whether real images were measured"
            )

    def title(self, variant: str) -> str:
        """The title of a variant, by which readers know it."""
        own = {row.variant: row.title for row in self.rows}
        return variant_title(variant, self.domain_label, own.get(variant, ""))


def variant_row(name: str, evaluation: Evaluation) -> VariantRow:
    """The table row of one variant, with the accuracy of its network's own poses."""
    training, metrics = evaluation.training, evaluation.accuracy.metrics
    size, real = training.recipe["size"], training.data.real
    scaled = training.has_backbone
    return VariantRow(
        variant=name,
        title=evaluation.title,
        metrics=metrics.as_dict(),
        training_images=training.data.training_images,
        test_images=metrics.images,
        steps=training.steps,
        batch_size=size["batch_size"],
        width=size["width"] if scaled else None,
        depth=size["depth"] if scaled else None,
        optimizer=size["optimizer"],
        detector_steps=size["detector_steps"] if training.variant["start"] else 0,
        seeds=(training.seed,),
        parameters=training.parameters,
        mixed_in_images=real.images if real else 0,
        summary=evaluation.accuracy.summary,
        depths=tuple(evaluation.accuracy.binned_errors["z_mm"]),
        training_id=training.training_id,
        data=(training.data.digest, *([real.digest] if real else [])),
        origin=evaluation.origin,
    )


def variant_title(variant: str, domain_label: str, own_title: str = "") -> str:
    """The paper's title of a variant, else its own title, else its name.

    If stand-ins replace real images, "D + real" becomes "D + stand-in".
    """
    title = TABLE_I[variant].title if variant in TABLE_I else own_title or variant
    parts = title.split(" + ")
    return " + ".join(domain_label if part == REAL else part for part in parts)


def choose_champion(validation: Mapping[str, MetricValues], margin: float) -> Champion:
    """The variant with the lowest tip error among those whose mAP is within `margin` of the best.

    validation: `mAP` and `tip_mm` on the validation images by variant, where known: a variant that
    detected no instrument has no tip error and comes last. Test images are not used, as a choice by
    their metrics would bias these metrics.
    """
    precision = {name: values.get("mAP") or 0.0 for name, values in validation.items()}
    close = [n for n, value in precision.items() if value >= max(precision.values()) - margin]
    tips = {name: validation[name].get("tip_mm") for name in close}
    far = {name: math.inf if tip is None else tip for name, tip in tips.items()}
    chosen = min(close, key=far.__getitem__)
    return Champion(
        chosen,
        "lowest mean tip error among the variants whose mAP is within "
        f"{margin:g} of the best, both on the validation images, where it has "
        + ", ".join(f"{name} {value:.3g}" for name, value in sorted(validation[chosen].items())
                    if name in ("mAP", "tip_mm") and value is not None),
    )  # fmt: skip
