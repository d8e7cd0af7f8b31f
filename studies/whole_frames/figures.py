"""Figures from compared shafts and detections."""

from collections.abc import Iterable, Sequence

import numpy as np

from shaftpose.core.geometry import Array
from shaftpose.inference.found_shafts import FoundShaft
from shaftpose.metrics.pose_errors import PoseErrors, errors_between
from studies.whole_frames.matching import TrueShaft
from studies.whole_frames.measurement import Comparison
from studies.whole_frames.record import Figure


def share(
    name: str, hits: Iterable[bool], least: float | None = None, most: float | None = None
) -> Figure:
    """The share of hits."""
    known = list(hits)
    value = sum(known) / len(known) if known else None
    return Figure(name, value, f"{sum(known)} of {len(known)}", least, most)


def mean(name: str, values: Sequence[float], most: float | None = None) -> Figure:
    """The mean of values."""
    return Figure(
        name, float(np.mean(values)) if len(values) else None, f"{len(values)}", most=most
    )


def seen(comparison: Comparison) -> list[TrueShaft]:
    """The shafts whose true tip is seen."""
    return [shaft for shaft in comparison.shafts if shaft.tip == "seen"]


def hits(shafts: Sequence[TrueShaft]) -> list[tuple[TrueShaft, FoundShaft]]:
    """The shafts that were found, each with its detection."""
    return [(shaft, shaft.found) for shaft in shafts if shaft.found is not None]


def found(
    shafts: Sequence[TrueShaft], name: str = "tips found", least: float | None = None
) -> Figure:
    """The share of shafts that were found."""
    return share(name, [shaft.found is not None for shaft in shafts], least)


def called(shafts: Sequence[TrueShaft], tip: str, name: str, most: float | None = None) -> Figure:
    """The share of found shafts whose tip was given this state."""
    return share(name, [one.tip == tip for _, one in hits(shafts)], most=most)


def false_ones(comparison: Comparison) -> list[Figure]:
    """Detections without a true tip, and those at the picture's border."""
    all_of, false = comparison.detections, [one for one in comparison.detections if one.is_false]
    at_edge = sum(one.at_edge and one.found.tip == "seen" for one in false)
    return [
        share("detections without a true tip", [one.is_false for one in all_of], most=0.02),
        Figure("of these, at the picture's edge, called seen", at_edge, f"{len(false)}", most=0),
    ]


def tip_errors_px(shafts: Sequence[TrueShaft]) -> list[float]:
    """Distances of found tips from the true ones, in px of the frame."""
    return [float(np.linalg.norm(one.tip_px - true.tip_px)) for true, one in hits(shafts)]


def errors_over_deviations(shafts: Sequence[TrueShaft]) -> Array:
    """(M, 5), of the shafts that were found, with deviations and a tip called seen."""
    stated = [
        (true, one.deviations)
        for true, one in hits(shafts)
        if one.tip == "seen" and one.deviations is not None
    ]
    errors = pose_errors([true for true, _ in stated]).absolute
    return np.asarray(errors / np.reshape([own for _, own in stated], (-1, 5)))


def pose_errors(shafts: Sequence[TrueShaft]) -> PoseErrors:
    """The errors of the shafts that were found."""
    pairs = [(one.pose.as_array(), true.pose) for true, one in hits(shafts)]
    poses, true_poses = np.reshape(pairs, (-1, 2, 5)).transpose(1, 0, 2)
    return errors_between(poses, true_poses)
