"""Pose errors of several trainings on the instruments that all of them detected.

Mean errors cover only detected instruments. A network that detects few, easy instruments therefore
looks more precise; on the common instruments no network has that advantage.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from shaftpose.metrics.pose_errors import PoseErrors

DECIMALS = 3  # of mm and deg: far finer than a network or a robot resolves


@dataclass(frozen=True)
class FoundInstruments:
    """The instruments that a training detected among the `total` of a test set, and their errors.

    Lists of equal length. `instruments`: numbers across the set; `errors`: see
    `PoseErrors.by_name`.
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
