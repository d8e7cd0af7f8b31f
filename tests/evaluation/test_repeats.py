"""Repeated trainings as one row, by hand, and the page that shows them."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from shaftpose.errors import InputError
from shaftpose.evaluation.ablation import AblationReport, Champion, VariantRow
from shaftpose.evaluation.repeats import by_scale, repeated
from shaftpose.evaluation.report import to_json
from shaftpose.evaluation.results_page import to_page

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tools"))

import results_page  # noqa: E402


def row(seed: int, variant: str = "d", steps: int = 3000, **metrics: float | None) -> VariantRow:
    title = variant.upper()
    return VariantRow(variant, metrics, 900, 100, steps, 16, 0.25, (seed,), 1_000, 0, title)


def test_mean_and_half_range_by_hand():
    three = [row(7, mAP=0.5, x_mm=1.0), row(8, mAP=0.6, x_mm=None), row(9, mAP=0.85, x_mm=3.0)]
    whole = repeated(three)
    assert whole.metrics == {"mAP": pytest.approx(0.65), "x_mm": None}
    assert whole.spread == {"mAP": pytest.approx(0.175)}
    assert whole.seeds == (7, 8, 9)


def test_only_trainings_of_one_scale_and_variant_are_put_together():
    rows = [row(7, mAP=0.5), row(8, mAP=0.7), row(7, "c", mAP=0.1), row(9, steps=10, mAP=0.9)]
    (first, second), (other,) = by_scale(rows).values()
    assert (first.variant, first.metrics) == ("d", {"mAP": pytest.approx(0.6)})
    assert second == rows[2]  # trained once: no spread
    assert other == rows[3]


def test_a_seed_that_was_trained_twice_counts_once():
    assert by_scale([row(7, mAP=0.5), row(7, mAP=0.7)]).popitem()[1] == [row(7, mAP=0.5)]


def page(*trainings: VariantRow) -> str:
    report = AblationReport([row(7, mAP=0.5)], {}, {}, "stand-in", Champion("d", "the only one"))
    return to_page(report, "demo", trainings, {"speed": {"machine": {"cores": 2}, "s": [{"a": 1}]}})


def test_the_page_shows_means_with_their_spread_beside_the_paper():
    text = page(row(8, mAP=0.7))
    assert "| D | 90,000 / 900 | n/a / 3,000 | 0.949 / 0.600 ± 0.100 |" in text
    assert "900 training images, 3,000 steps of 16, width 0.25. Seeds: D: 7, 8." in text
    assert "±" not in page()


def test_the_page_shows_benchmarks():
    assert "| machine.cores | 2 |" in page()
    assert "s:\n\n| a |\n| --- |\n| 1 |" in page()


def test_the_recorded_report_is_read_as_it_was_written():
    rows = [row(7, mAP=0.5), repeated([row(7, "c", mAP=0.1), row(8, "c", mAP=0.3)])]
    report = AblationReport(rows, {"mAP": 0.0}, {}, "stand-in", Champion("d", "the best one"))
    assert results_page.read_report(json.loads(to_json(report))) == report


def test_a_run_of_no_profile_is_refused():
    with pytest.raises(InputError, match="no profile"):
        results_page.profile_of([replace(row(7), width=0.3)], {})
