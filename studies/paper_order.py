"""Comparison of repeated trainings with the paper's order of its architectures."""

from collections.abc import Sequence
from dataclasses import dataclass

from shaftpose.metrics.table import metrics_of
from shaftpose.report.ablation import VariantRow
from shaftpose.report.paper_numbers import TABLE_I

# Variants before and after each step of the paper. The step to D + noise + real is left out: it is
# meant for real images, and the paper's values on rendered ones hardly change.
STEPS = (("b", "c"), ("b", "d"), ("c", "d"), ("d", "d_noise"))
PAPER_METRICS = tuple(one for one in metrics_of("detection", "pose") if one.in_paper)
ROTATIONS = ("pitch_deg", "yaw_deg")
AS_IN_PAPER, REVERSED = "as in the paper", "reversed"
UNDECIDED, SILENT = "within the spread", "the paper is silent"


@dataclass(frozen=True)
class Change:
    """Change of a metric in a step (after minus before), and its agreement with the paper."""

    difference: float
    verdict: str


def changes(rows: Sequence[VariantRow]) -> dict[tuple[str, str], dict[str, Change]]:
    """The changes by step and metric.

    rows: variants of one scale. A difference is undecided if it is no larger than the sum of both
    half ranges; a variant trained once gets the largest half range of the repeated ones. Metrics
    that are missing or were never repeated are left out.
    """
    known = {row.variant: row for row in rows if not row.refined}
    found = {}
    for before, after in STEPS:
        if before in known and after in known:
            pair = (known[before], known[after])
            step = {one.name: _change(*pair, one.name, rows) for one in PAPER_METRICS}
            found[before, after] = {name: change for name, change in step.items() if change}
    return {step: values for step, values in found.items() if values}


def _change(
    before: VariantRow, after: VariantRow, metric: str, rows: Sequence[VariantRow]
) -> Change | None:
    rises = _rises(before.variant, after.variant, metric)
    first, second = before.metrics.get(metric), after.metrics.get(metric)
    spreads = [value for row in rows if (value := row.spread.get(metric)) is not None]
    if first is None or second is None or not spreads:
        return None
    difference = second - first
    noise = sum(row.spread.get(metric, max(spreads)) or 0.0 for row in (before, after))
    if abs(difference) <= noise:
        return Change(difference, UNDECIDED)
    if rises is None:
        return Change(difference, SILENT)
    return Change(difference, AS_IN_PAPER if (difference > 0) == rises else REVERSED)


def _rises(before: str, after: str, metric: str) -> bool | None:
    """Whether a value grows in the paper's Table I; None if the paper does not state it.

    B is in no table, but the paper calls its rotation steps too coarse (I-B).
    """
    if before == "b":
        return False if metric in ROTATIONS else None
    values = [float(getattr(TABLE_I[variant], metric)) for variant in (before, after)]
    return values[1] > values[0]
