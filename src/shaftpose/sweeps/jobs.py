"""The trainings of a sweep, and their swept settings."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

NO_VALUE = "-"
VARIANT = "variant.name"
_LONGEST = 30  # characters of a value that fit into a figure


@dataclass(frozen=True)
class SweepJob:
    """One training of a sweep: its parameters as text and the metrics of its result, by name.

    A job may lack parameters that others have (such as the width of B's classes) and metrics
    without a value (pose errors, if nothing is detected). `steps`: up to the result's validation.
    """

    parameters: Mapping[str, str]
    metrics: Mapping[str, float]
    steps: int = 0


def swept_parameters(jobs: Sequence[SweepJob]) -> list[str]:
    """The names of the parameters that differ between jobs.

    Parameters of the variant's file that follow from its name or repeat another one are left out.
    """
    names = sorted({name for job in jobs for name in job.parameters})
    swept = [name for name in names if len({job.parameters.get(name) for job in jobs}) > 1]
    own = [n for n in swept if not (n.startswith("variant.") and _follows(jobs, n))]
    return [
        n for n in own if n == n.removeprefix("variant.") or n.removeprefix("variant.") not in own
    ]


def _follows(jobs: Sequence[SweepJob], name: str) -> bool:
    """Whether a parameter, not the variant's name itself, is the same in all jobs of a variant."""
    pairs = {(job.parameters.get(VARIANT), job.parameters.get(name)) for job in jobs}
    return name != VARIANT and len(pairs) == len({variant for variant, _ in pairs})


def values_of(jobs: Sequence[SweepJob], name: str) -> list[str]:
    """A parameter's value in each job; `-` where a job lacks it."""
    return [job.parameters.get(name, NO_VALUE) for job in jobs]


def in_order(values: Sequence[str]) -> list[str]:
    """Distinct values: numbers by size, then texts alphabetically, `-` last."""
    return sorted(set(values), key=_order)


def shortened(value: str) -> str:
    """A value as shown in figures; only the end of a long one."""
    return value if len(value) <= _LONGEST else f"…{value[1 - _LONGEST :]}"


def _order(value: str) -> tuple[bool, float, str]:
    try:
        return False, float(value), ""
    except ValueError:
        return value == NO_VALUE, math.inf, value
