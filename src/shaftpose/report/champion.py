"""The choice of the best variant, and what the model registry says of it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

from shaftpose.evaluation.results import Evaluation
from shaftpose.metrics.best import best_of
from shaftpose.metrics.table import MetricValues
from shaftpose.settings.tree import Settings

MERITS = ("mAP", "tip_mm")


@dataclass(frozen=True)
class Champion:
    """The variant chosen for deployment, whether with refined poses, and the rule as a sentence."""

    variant: str
    refined: bool
    rule: str


def choose_champion(evaluations: Mapping[str, Evaluation], margin: float) -> Champion:
    """The best variant on the validation images: a choice by test metrics would bias these."""
    validation = {name: one.validation for name, one in evaluations.items()}
    chosen = best_of(validation, margin)
    return Champion(
        chosen,
        evaluations[chosen].refined is not None,
        "lowest mean tip error among the variants whose mAP is within "
        f"{margin:g} of the best, both on the validation images, where it has "
        + ", ".join(f"{name} {value:.3g}" for name, value in _merits(validation[chosen]).items()),
    )


def _merits(validation: MetricValues) -> dict[str, float]:
    return {name: value for name in MERITS if (value := validation.get(name)) is not None}


class Candidate(NamedTuple):
    """The best variant's model as the registry takes it: see `tracking.registry`."""

    training_id: str
    name: str
    rule: str
    tags: Mapping[str, str]
    is_better: Callable[[Mapping[str, str]], bool]


def candidate(
    champion: Champion, evaluations: Mapping[str, Evaluation], settings: Settings
) -> Candidate:
    """The champion's model as a candidate for the registry."""
    evaluation = evaluations[champion.variant]
    tags, margin = version_tags(settings, evaluation), settings.report.champion_margin
    return Candidate(
        evaluation.training.training_id,
        champion.variant,
        champion.rule,
        tags,
        partial(is_better, tags, margin=margin),
    )


def version_tags(settings: Settings, evaluation: Evaluation) -> dict[str, str]:
    """The tags of a model in the registry.

    dataset: digest of the rendered images and their split; mAP, tip_mm: on the validation images.
    """
    shaft, camera = settings.shaft, settings.camera
    shape = shaft.cad.file.name if shaft.cad else f"{shaft.diameter_mm:g} mm, {shaft.tip}"
    return {
        "profile": settings.profile,
        "dataset": evaluation.training.data.digest,
        "commit": evaluation.origin.commit if evaluation.origin else "",
        "shaft": shape,
        "camera": f"{camera.size_px} px, {camera.view_deg:g} deg",
    } | {name: f"{value:.6g}" for name, value in _merits(evaluation.validation).items()}


def is_better(tags: Mapping[str, str], other: Mapping[str, str], margin: float) -> bool:
    """Whether the model with `tags` is better than the `other`, by the rule of `best_of`."""
    known = {
        name: {merit: float(one[merit]) for merit in MERITS if merit in one}
        for name, one in (("other", other), ("this", tags))
    }
    return best_of(known, margin) == "this"
