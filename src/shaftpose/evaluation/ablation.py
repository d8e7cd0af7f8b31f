"""The plain data of an ablation study: what was trained, on how much, and what it scored."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from shaftpose.errors import InputError
from shaftpose.evaluation.paper_tables import TABLE_I

STAND_IN = "stand-in"
REAL = "real"

MetricValues = Mapping[str, float | int | None]


@dataclass(frozen=True)
class VariantRow:
    """One variant, trained once or, with other seeds, several times.

    `metrics` are those of `Metrics.as_dict()`, means over `seeds`; `spread` is half the range of
    each, empty if it was trained once. `width` and `depth` multiply the backbone's channels and
    blocks; `detector_steps` are those of the detector that it started from, 0 for random weights;
    `parameters` counts the network's weights. `mixed_in_images` are real, or stand-in, images that
    it was trained on besides `training_images`. `title` is needed only by variants that the paper
    does not have.
    """

    variant: str
    metrics: MetricValues
    training_images: int
    test_images: int
    steps: int
    batch_size: int
    width: float
    depth: float
    optimizer: str
    detector_steps: int
    seeds: tuple[int, ...]
    parameters: int
    mixed_in_images: int = 0
    title: str = ""
    spread: MetricValues = field(default_factory=dict)


@dataclass(frozen=True)
class Champion:
    """The variant that goes on to deployment, and the rule it was chosen by, as one sentence."""

    variant: str
    rule: str


@dataclass(frozen=True)
class AblationReport:
    """Everything the report shows.

    `profile`: the sizes of the run, by their name in conf/profiles.yaml. `constant`: metrics of the
    constant predictor. `domain_label`: what the "real" domain was in this study, `stand-in` or
    `real`. `silhouette`: by variant and set of images (`rendered/clear`, `rendered/occluded` and
    the same of the domain, such as `stand-in/clear`) the fields of a `SilhouetteScore`. `figures`:
    PNG files by title.
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


def variant_row(name: str, result: Mapping[str, Any]) -> VariantRow:
    """The table line of one variant, of the plain values that its evaluation wrote."""
    training, metrics = result["training"], result["metrics"]
    size = training["recipe"]["size"]
    return VariantRow(
        variant=name,
        title=result["title"],
        metrics=metrics,
        training_images=training["training_images"],
        test_images=metrics["images"],
        steps=training["steps"],
        batch_size=training["batch_size"],
        width=training["width"],
        depth=training["depth"],
        optimizer=size["optimizer"],
        detector_steps=size["detector_steps"] if training["variant"]["start"] else 0,
        seeds=(training["seed"],),
        parameters=training["parameters"],
        mixed_in_images=training["real"]["images"] if training["real"] else 0,
    )


def variant_title(variant: str, domain_label: str, own_title: str = "") -> str:
    """The paper's title of a variant, or else its own (its name if it has none).

    If stand-ins were used for real images, "D + real" is called "D + stand-in".
    """
    title = TABLE_I[variant].title if variant in TABLE_I else own_title or variant
    parts = title.split(" + ")
    return " + ".join(domain_label if part == REAL else part for part in parts)


def choose_champion(validation: Mapping[str, Mapping[str, float]], margin: float) -> Champion:
    """The variant with the least tip error among those whose mAP is within `margin` of the best.

    validation: `mAP` and `tip_mm` on the validation images by variant, as far as they are known: a
    variant that found no instrument has no tip error and comes last. Not those on the test images,
    whose numbers would flatter whatever was chosen by them.
    """
    best = max(values.get("mAP", 0.0) for values in validation.values())
    close = [name for name, values in validation.items() if values.get("mAP", 0.0) >= best - margin]
    chosen = min(close, key=lambda name: validation[name].get("tip_mm", math.inf))
    return Champion(
        chosen,
        "least mean tip error among the variants whose mAP is within "
        f"{margin:g} of the best, both on the validation images, where it has "
        + ", ".join(f"{name} {value:.3g}" for name, value in sorted(validation[chosen].items())
                    if name in ("mAP", "tip_mm")),
    )  # fmt: skip
