"""Choice of the best variant, and its comparison with the champion of the registry."""

from dataclasses import replace

from shaftpose.evaluation.results import Evaluation
from shaftpose.report.champion import choose_champion, is_better, version_tags
from tests.evaluations import METRICS, accuracy, evaluation
from tests.pipeline.conftest import settings_with


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


def test_the_registry_says_what_a_model_is_for() -> None:
    one = validated(0.9765432, None)
    assert version_tags(settings_with("profile=demo"), one) == {
        "profile": "demo",
        "dataset": one.training.data.digest,
        "commit": one.origin.commit if one.origin else "",
        "shaft": "3 mm, flat",
        "camera": "299 px, 95 deg",
        "mAP": "0.976543",
    }


def test_a_model_is_better_by_the_tip_at_about_the_same_precision() -> None:
    old = {"mAP": "0.97", "tip_mm": "3.0"}
    for new, better in (
        ({"mAP": "0.96", "tip_mm": "2.5"}, True),
        ({"mAP": "0.94", "tip_mm": "2.5"}, False),
        ({"mAP": "0.99", "tip_mm": "3.5"}, False),  # within the margin, the tip decides
        ({"mAP": "1.00", "tip_mm": "3.5"}, True),
        ({"mAP": "0.98"}, False),
        (old, False),
    ):
        assert is_better(new, old, margin=0.02) is better, new
