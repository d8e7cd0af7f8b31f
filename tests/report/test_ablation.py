"""Choice of the champion."""

from dataclasses import replace

from shaftpose.evaluation.results import Evaluation
from shaftpose.report.ablation import choose_champion
from tests.evaluations import METRICS, accuracy, evaluation


def validated(mAP: float | None, tip_mm: float | None = None) -> Evaluation:
    one = evaluation("any")
    return replace(one, validation={**METRICS, "mAP": mAP, "tip_mm": tip_mm})


def test_the_least_tip_error_among_the_best_wins() -> None:
    validation = {
        "c": validated(0.60, 1.0),  # 0.03 below the best
        "d": validated(0.63, 3.0),
        "d_noise": validated(0.62, 2.0),
    }
    assert choose_champion(validation, margin=0.02).variant == "d_noise"
    assert choose_champion(validation, margin=0.0).variant == "d"
    champion = choose_champion(validation, margin=0.05)
    assert champion.variant == "c"
    assert "within 0.05 of the best" in champion.rule


def test_who_found_nothing_comes_last() -> None:
    validation = {"c": validated(0.5), "d": validated(0.5, 9.0), "e": validated(None)}
    assert choose_champion(validation, margin=0.02).variant == "d"


def test_a_champion_with_a_fit_is_used_with_it() -> None:
    raw = validated(0.5)
    assert not choose_champion({"e": raw}, margin=0.02).refined
    assert choose_champion({"e": replace(raw, refined=accuracy())}, margin=0.02).refined
