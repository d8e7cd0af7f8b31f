"""Pose errors of several trainings on the same instruments: those that all of them found.

A mean error is of the instruments that a network found. One that finds few of them, the easy ones,
looks the more precise for it; on the instruments that all found, none has that advantage.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from shaftpose.evaluation.pose_errors import PoseErrors

DECIMALS = 3  # of mm and deg that are kept: far below what a network or a robot resolves


@dataclass(frozen=True)
class FoundInstruments:
    """Which of the `total` instruments of a test set a training found, and their errors.

    Lists of one length: `instruments` are numbers, counted through the set; `errors` are those of
    `PoseErrors.by_name`.
    """

    total: int
    instruments: Sequence[int]
    errors: Mapping[str, Sequence[float]]


def found_instruments(errors: PoseErrors, total: int) -> FoundInstruments:
    """What is kept of pose errors on a test set of `total` instruments, as plain numbers."""
    return FoundInstruments(
        total,
        errors.instruments.tolist(),
        {name: values.round(DECIMALS).tolist() for name, values in errors.by_name.items()},
    )


def common_instruments(trainings: Sequence[FoundInstruments]) -> set[int]:
    """The instruments that every one of these trainings found, on one test set."""
    return set.intersection(*(set(found.instruments) for found in trainings))


def means_on(found: FoundInstruments, instruments: set[int]) -> dict[str, float | None]:
    """Mean errors of one training on these of its instruments; None if there are none."""
    chosen = [n for n, instrument in enumerate(found.instruments) if instrument in instruments]
    return {
        name: float(np.mean([values[n] for n in chosen])) if chosen else None
        for name, values in found.errors.items()
    }
