"""Choice of the champion."""

from shaftpose.report.ablation import Champion, choose_champion


def test_the_least_tip_error_among_the_best_wins() -> None:
    validation = {
        "c": {"mAP": 0.60, "tip_mm": 1.0},  # 0.03 below the best
        "d": {"mAP": 0.63, "tip_mm": 3.0},
        "d_noise": {"mAP": 0.62, "tip_mm": 2.0},
    }
    assert choose_champion(validation, margin=0.02).variant == "d_noise"
    assert choose_champion(validation, margin=0.0).variant == "d"
    champion = choose_champion(validation, margin=0.05)
    assert champion.variant == "c"
    assert "within 0.05 of the best" in champion.rule


def test_who_found_nothing_comes_last() -> None:
    validation = {"c": {"mAP": 0.5}, "d": {"mAP": 0.5, "tip_mm": 9.0}, "e": {"mAP": None}}
    assert choose_champion(validation, margin=0.02).variant == "d"


def test_a_champion_with_fitted_poses_names_its_training() -> None:
    assert Champion("e+fit", "rule").trained == "e"
    assert Champion("d", "rule").trained == "d"
