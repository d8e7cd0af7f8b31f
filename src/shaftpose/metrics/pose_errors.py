"""Pose errors of the detected instruments, also on those that several trainings detected.

Mean errors cover only detected instruments. A network that detects few, easy instruments therefore
looks more precise; on the instruments that all networks detected, none has that advantage.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from shaftpose.core.geometry import axis_direction, signed_deg
from shaftpose.core.instruments import POSE_DIMENSIONS, Annotations, Detections
from shaftpose.metrics.detection.matching import Array, Indices, matched_poses

YAW = POSE_DIMENSIONS.index("yaw_deg")
DECIMALS = 3  # of recorded mm and deg: far finer than a network or a robot resolves


@dataclass(frozen=True)
class PoseErrors:
    """Errors of M instruments.

    differences: (M, 5) predicted minus true in mm and deg, yaw wrapped to [-180, 180);
    axis_deg: (M,) angle between the shafts' axes; tip_mm: (M,) distance between the tips;
    true_poses: (M, 5); instruments: (M,) their numbers across all images.
    """

    differences: Array
    axis_deg: Array
    tip_mm: Array
    true_poses: Array
    instruments: Indices

    @property
    def absolute(self) -> Array:
        """(M, 5) absolute differences; yaw in [0, 180] deg."""
        return np.abs(self.differences)

    @property
    def by_name(self) -> dict[str, Array]:
        """(M,) absolute errors by metric name."""
        errors = dict(zip(POSE_DIMENSIONS, self.absolute.T, strict=True))
        return errors | {"axis_deg": self.axis_deg, "tip_mm": self.tip_mm}

    def means(self) -> dict[str, float | None]:
        """Mean absolute error by metric name; None where no instrument was matched."""
        return {name: float(np.mean(e)) if len(e) else None for name, e in self.by_name.items()}


def pose_errors(
    detections: Sequence[Detections], annotations: Sequence[Annotations], confidence: float = 0.5
) -> PoseErrors:
    """Errors of the instruments that a detection with a score of at least `confidence` matches.

    Images without known poses are skipped.
    """
    predicted, true = [np.empty((0, 5))], [np.empty((0, 5))]
    instruments, offset = [np.empty(0, dtype=np.intp)], 0
    for found, known in zip(detections, annotations, strict=True):
        if known.poses is not None:
            poses, matched = matched_poses(found, known.boxes, confidence)
            predicted.append(poses)
            true.append(known.poses[matched])
            instruments.append(matched + offset)
        offset += len(known.boxes)
    errors = errors_between(np.concatenate(predicted), np.concatenate(true))
    return replace(errors, instruments=np.concatenate(instruments))


def errors_between(predicted: Array, true: Array) -> PoseErrors:
    """Errors of predicted poses (M, 5) paired with true poses (M, 5), numbered in their order."""
    differences = predicted - true
    differences[:, YAW] = signed_deg(differences[:, YAW])
    axes = axis_direction(predicted[:, 3], predicted[:, 4]), axis_direction(true[:, 3], true[:, 4])
    return PoseErrors(
        differences=differences,
        axis_deg=_angles_deg(*axes),
        tip_mm=np.linalg.norm(differences[:, :3], axis=-1),
        true_poses=true,
        instruments=np.arange(len(true)),
    )


def _angles_deg(a: Array, b: Array) -> Array:
    """Angles (M,) between unit vectors (M, 3); unlike arccos, also exact for small angles."""
    sine = np.linalg.norm(np.cross(a, b), axis=-1)
    return np.degrees(np.arctan2(sine, np.sum(a * b, axis=-1)))


@dataclass(frozen=True)
class FoundInstruments:
    """The instruments that a training detected, of `total` in a test set, and their errors.

    instruments: their numbers across the set; errors: of each of them, by metric name.
    """

    total: int
    instruments: Sequence[int]
    errors: Mapping[str, Sequence[float]]


def found_instruments(errors: PoseErrors, total: int) -> FoundInstruments:
    """Rounded pose errors on a test set of `total` instruments, as plain numbers."""
    return FoundInstruments(
        total,
        errors.instruments.tolist(),
        {name: values.round(DECIMALS).tolist() for name, values in errors.by_name.items()},
    )


def common_instruments(trainings: Sequence[FoundInstruments]) -> set[int]:
    """The instruments of one test set that all trainings detected."""
    return set.intersection(*(set(found.instruments) for found in trainings))


def means_on(found: FoundInstruments, instruments: set[int]) -> dict[str, float | None]:
    """Mean errors of one training on the given instruments; None if it detected none."""
    chosen = [n for n, instrument in enumerate(found.instruments) if instrument in instruments]
    return {
        name: float(np.mean([values[n] for n in chosen])) if chosen else None
        for name, values in found.errors.items()
    }
