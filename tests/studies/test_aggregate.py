"""Repeated trainings as one row, their comparison with the paper, and their page."""

import json
import re
from dataclasses import asdict, replace
from pathlib import Path

import pytest

from shaftpose.core.errors import InputError
from shaftpose.core.files import write_json
from shaftpose.metrics.binned_errors import BINS, ErrorBin
from shaftpose.metrics.pose_errors import FoundInstruments
from shaftpose.report.ablation import AblationReport, VariantRow
from shaftpose.report.champion import Champion
from shaftpose.report.page import to_json
from shaftpose.stage_files import MixedInImages
from studies import write_results_page as results_page
from studies.aggregate import by_scale, repeated, rows_of
from studies.paper_order import Change, changes
from studies.record import EvaluatedTraining, read_record, validation_curves
from studies.results_page import Table, to_page
from studies.table import repeated_figures

ROOT = Path(__file__).parents[2]


def row(seed: int, variant: str = "d", steps: int = 3000, **metrics: float | None) -> VariantRow:
    title = variant.upper()
    sizes = (900, 100, steps, 16, 0.25, 0.5, "muon", 700)
    return VariantRow(variant, metrics, *sizes, (seed,), 1_000, 0, title)


def test_mean_and_half_range_by_hand():
    three = [row(7, mAP=0.5, x_mm=1.0), row(8, mAP=0.6, x_mm=None), row(9, mAP=0.85, x_mm=3.0)]
    three[0] = replace(three[0], depths=(ErrorBin(10.0, 15.0, 3, 1.0, 2.0),), training_id="first")
    whole = repeated(three)
    assert (whole.depths, whole.training_id) == ((), "")  # those of one of them
    assert whole.metrics == {"mAP": pytest.approx(0.65), "x_mm": None}
    assert whole.spread == {"mAP": pytest.approx(0.175)}
    assert whole.seeds == (7, 8, 9)


def with_silhouettes(one: VariantRow, iou: float) -> VariantRow:
    clear = {"detected_rate": 0.5, "iou": iou, "iou_low": 0.0, "iou_high": 1.0}
    return replace(one, silhouettes={"rendered/clear": clear})


def test_silhouettes_of_all_seeds_are_averaged():
    first, second = with_silhouettes(row(7), 0.25), with_silhouettes(row(8), 0.5)
    both = {"rendered/clear": {"detected_rate": 0.5, "iou": 0.375}}
    assert repeated([first, second]).silhouettes == both
    assert repeated([first, row(8)]).silhouettes == {}
    assert "| rendered | D | 0.500 | 0.375 |" in page(record(first), record(second))
    assert "0.250 (0.00 to 1.00)" in page(record(first))
    assert "Silhouettes, as in" not in page(record(row(7)))


FOUND = FoundInstruments(4, [0, 2, 3], {"z_mm": [0.5, 1.5, 2.5], "tip_mm": [1.0, 2.0, 6.0]})


def record(
    trained: VariantRow,
    alpha: float = 1.5,
    found: FoundInstruments = FOUND,
    data: str = "same",
    noise: int = 0,
    real: str = "",
) -> EvaluatedTraining:
    bins = {name: [ErrorBin(0.0, 1.0, 2, 4.0, 6.0)] for name in BINS}
    curves = [(9, "train/loss", 1.0), (9, "validation/mAP", 0.25)]
    recipe = {
        "size": {
            "steps": 3000, "batch_size": 16, "width": 0.25, "depth": 0.5,
            "precision": "32-true", "learning_rate": 2e-3, "optimizer": "muon",
            "detector_steps": 700,
        },
        "training": {"frozen_norm_share": 0.3},
        "loss": {"alpha": alpha, "gamma": 5.0, "beta": [1.0, 1.0, 2.0, 2.0, 0.5]},
    }  # fmt: skip
    mixed_in = MixedInImages(real, 2, f"{real} images") if real else None
    return EvaluatedTraining(
        trained, recipe, {"noise": noise}, data, mixed_in, bins, found, validation_curves(curves)
    )


def test_only_trainings_of_one_scale_and_variant_are_put_together():
    rows = [row(7, mAP=0.5), row(8, mAP=0.7), row(7, "c", mAP=0.1), row(9, steps=10, mAP=0.9)]
    alike, others = by_scale([record(one) for one in rows]).values()
    first, second = rows_of(alike)
    assert (first.variant, first.metrics) == ("d", {"mAP": pytest.approx(0.6)})
    assert second == rows[2]  # trained once: no spread
    assert rows_of(others) == [rows[3]]


def test_trainings_with_other_loss_weights_are_no_repeats():
    records = [record(row(7, mAP=0.5)), record(row(8, mAP=0.7), alpha=0.5)]
    assert [rows_of(alike) for alike in by_scale(records).values()] == [
        [row(7, mAP=0.5)],
        [row(8, mAP=0.7)],
    ]


def test_a_seed_that_was_recorded_twice_is_refused():
    with pytest.raises(InputError, match=r"reports/trainings/d-7-\*\.json: two records"):
        by_scale([record(row(7, mAP=0.5)), record(row(7, mAP=0.7))])


def test_trainings_of_other_settings_of_a_variant_are_no_repeats():
    records = [record(row(7)), record(row(8), noise=10)]
    with pytest.raises(InputError, match=r"d-7-\*\.json and .*/d-8-\*\.json: trained with differ"):
        by_scale(records)
    assert len(by_scale([record(row(7)), record(row(7, "d_noise"), noise=10)])) == 1


def test_variants_that_the_page_could_not_tell_apart_are_refused():
    with pytest.raises(InputError, match=r"/d-7-.* and .*/mine-7-.*: two variants with the title"):
        by_scale([record(row(7)), record(replace(row(7, "mine"), title="D"))])


def test_trainings_on_other_real_images_are_not_compared():
    plain, real = record(row(7)), record(row(7, "d_noise_real"), real="real")
    assert len(by_scale([plain, real])) == 1
    with pytest.raises(
        InputError, match=r"real-7-\*\.json and .*real-8-\*\.json: trained with differ"
    ):
        by_scale([plain, real, record(row(8, "d_noise_real"), real="stand-in")])


@pytest.mark.parametrize("domain", ["real", "stand-in"])
def test_titles_say_what_was_mixed_in_whatever_the_recorded_run_had(domain: str):
    text = page(record(row(7)), record(row(7, "d_noise_real"), real=domain))
    assert f"| D + noise + {domain} | 90,000 / 900 |" in text


def several(variant: str, *values: float, metric: str = "x_mm") -> VariantRow:
    return repeated([row(7 + n, variant, **{metric: value}) for n, value in enumerate(values)])


def test_changes_are_judged_by_the_spread_of_both_values():
    # The paper: x 1.51 mm in C, 0.81 in D, 0.65 in D + noise.
    rows = [several("c", 5.0, 6.0), several("d", 4.2, 4.4), several("d_noise", 4.0, 4.4)]
    assert changes(rows) == {
        ("c", "d"): {"x_mm": Change(pytest.approx(-1.2), "as in the paper")},  # spread 0.5 + 0.1
        ("d", "d_noise"): {"x_mm": Change(pytest.approx(-0.1), "within the spread")},  # 0.1 + 0.2
    }


def test_a_variant_trained_once_is_taken_to_spread_as_much_as_any():
    rows = [several(v, *yaws, metric="yaw_deg") for v, yaws in
            {"b": (3.0,), "c": (5.0, 6.0), "d": (6.4,)}.items()]  # fmt: skip
    assert changes(rows) == {
        ("b", "c"): {"yaw_deg": Change(pytest.approx(2.5), "reversed")},
        ("b", "d"): {"yaw_deg": Change(pytest.approx(3.4), "reversed")},
        ("c", "d"): {"yaw_deg": Change(pytest.approx(0.9), "within the spread")},
    }


def test_of_the_positions_of_b_the_paper_says_nothing():
    found = changes([several("b", 3.0, 3.0), several("c", 5.0, 6.0)])
    assert found["b", "c"]["x_mm"].verdict == "the paper is silent"


def test_more_detections_are_judged_by_what_the_paper_measured():
    # The paper: mAP 0.958 in C, 0.949 in D; of B it states only that its rotations are too coarse.
    rows = [several(v, *maps, metric="mAP") for v, maps in
            {"b": (0.1, 0.2), "c": (0.5, 0.6), "d": (0.8, 0.9)}.items()]  # fmt: skip
    assert changes(rows) == {
        ("b", "c"): {"mAP": Change(pytest.approx(0.4), "the paper is silent")},
        ("b", "d"): {"mAP": Change(pytest.approx(0.7), "the paper is silent")},
        ("c", "d"): {"mAP": Change(pytest.approx(0.3), "reversed")},
    }


def test_without_a_repeated_training_nothing_is_judged():
    assert changes([several("c", 5.0), several("d", 4.0)]) == {}


def test_a_record_is_read_as_it_was_written(tmp_path: Path):
    one = record(row(8, mAP=0.7))
    assert one.curves == [(9, "validation/mAP", 0.25)]
    write_json(tmp_path / "d.json", asdict(one))
    assert read_record(tmp_path / "d.json") == one


def test_a_record_without_settings_is_refused(tmp_path: Path):
    content = asdict(record(row(8)))
    del content["recipe"]
    write_json(tmp_path / "d.json", content)
    with pytest.raises(InputError, match=r"d\.json: of another version.*\(recipe: .*record the"):
        read_record(tmp_path / "d.json")


def page(*trainings: EvaluatedTraining, sweeps: dict[str, Table] | None = None) -> str:
    report = AblationReport(
        [row(7, mAP=0.5)], {}, "stand-in", Champion("d", False, "the only one"), "demo"
    )
    speed = {"speed": {"machine": {"cores": 2}, "s": [{"a": 1}]}}
    return to_page(report, trainings, "| what classes cost |", sweeps or {}, speed, {}, "../docs/")


def test_the_page_shows_means_with_their_spread_beside_the_paper():
    text = page(record(row(8, mAP=0.7)), record(row(9, mAP=0.9)))
    assert "| D | 90,000 / 900 | n/a / 3,000 | 0.949 / 0.800 ± 0.100 |" in text
    assert (
        "900 training images, 100 test images; 3,000 steps of 16 images at width 0.25, "
        "depth 0.5, optimiser Muon, precision 32-true, "
        "learning rate 0.002, batch normalisation frozen in the last "
        "30%; loss weights alpha 1.5, gamma 5, beta 1, 1, 2, 2, 0.5.\n" in text
    )
    assert "Seeds: D: 8, 9.\n" in text
    assert "±" not in page()


def test_errors_are_compared_on_the_instruments_that_all_trainings_found():
    less = FoundInstruments(4, [3, 2], {"z_mm": [1.0, 3.0], "tip_mm": [4.0, 5.0]})
    trainings = [record(row(7)), record(row(8), found=less), record(row(7, "c"), found=less)]
    text = page(*trainings)
    # All detected 2 and 3: tip errors are 2 and 6 mm with seed 7, 5 and 4 mm with seed 8.
    assert "2 of 4 instruments that all these trainings detected" in text
    # Depth errors are 1.5 and 2.5 mm, and 3 and 1 mm. There are no other errors.
    other = "n/a | n/a |"
    assert f"| D | {other} 2.00 ± 0.00 | {other} n/a | 4.25 ± 0.25 |" in text
    assert f"| C | {other} 2.00 | {other} n/a | 4.50 |" in text


def test_trainings_on_other_images_are_not_compared():
    text = page(record(row(7, mAP=0.5)), record(row(8, mAP=0.7), data="other"))
    assert "| data | same | other |\n" in text
    assert "0.949 / 0.500 |" in text and "0.949 / 0.700 |" in text


def test_a_page_says_what_sets_scales_apart():
    text = page(record(row(7)), record(row(8, steps=1000), alpha=0.5))
    assert "| Setting | 900 images, 3,000 steps | 900 images, 1,000 steps |\n" in text
    assert "| steps | 3000 | 1000 |\n| loss.alpha | 1.5 | 0.5 |\n\n" in text
    assert "Settings in which they differ" not in page(record(row(7)), record(row(8)))


def test_trainings_with_mirrored_and_turned_images_say_so():
    turned = replace(record(row(7), data="other"), variant={"symmetries": True})
    assert "\n### 900 images, 3,000 steps, symmetries\n" in page(record(row(7)), turned)


def test_headings_tell_scales_of_equal_sizes_apart():
    one = record(row(7))
    wide = replace(one, recipe=one.recipe | {"size": one.recipe["size"] | {"width": 1.0}})
    first, other = "900 images, 3,000 steps", "900 images, 3,000 steps, size.width 1.0"
    text = page(one, wide)
    assert f"| Setting | {first} | {other} |\n" in text
    assert f"\n### {first}\n" in text and f"\n### {other}\n" in text


def test_a_setting_that_differs_is_named_once():
    one = record(row(7))
    sizes = one.recipe["size"] | {"steps": 1000, "width": 1.0}
    text = page(one, replace(record(row(7, steps=1000)), recipe=one.recipe | {"size": sizes}))
    # The steps taken equal the planned steps.
    assert "| steps | 3000 | 1000 |\n| size.width | 0.25 | 1.0 |\n\n" in text


def test_a_single_training_is_compared_with_no_other():
    assert "instruments that all these" not in page(record(row(7)))


def test_trainings_that_share_no_instrument_have_no_errors_to_compare():
    nothing = FoundInstruments(4, [], {"tip_mm": []})
    text = page(record(row(7)), record(row(8), found=nothing))
    assert "0 of 4 instruments that all these" in text
    assert f"| D |{' n/a |' * 7}" in text


def test_the_page_says_that_a_training_was_ended_before_its_last_step():
    # Statistics are frozen after step 2,100, for the last 30 % of the planned steps.
    assert "1,000 of 3,000 planned steps of 16" in page(record(row(8, steps=1000, mAP=0.7)))
    assert "frozen in the last 0%;" in page(record(row(8, steps=1000)))
    assert "frozen in the last 16%;" in page(record(row(8, steps=2500)))


def test_the_page_says_what_follows_for_the_papers_order():
    text = page(*map(record, (row(7, mAP=0.5), row(8, mAP=0.7), row(7, "c", mAP=0.1))))
    assert "| Step | mAP |" in text
    assert "| C to D | +0.500 reversed | n/a |" in text  # 0.6 - 0.1, spread 0.1 + 0.1


def test_errors_are_judged_on_the_same_instruments():
    hard = FoundInstruments(4, [0, 1], {"z_mm": [0.5, 9.5], "tip_mm": [1.0, 9.0]})
    trainings = [record(row(7, z_mm=1.5)), record(row(8, z_mm=1.5))]
    text = page(*trainings, record(row(7, "c", z_mm=5.0), found=hard))
    # C's error is 5 mm for an instrument that D does not detect, and 0.5 mm, as D's, for the other.
    assert re.search(r"\| C to D \|( n/a \|){4} \+0.00 within the spread \|", text)


def test_the_page_shows_the_pictures_that_are_drawn():
    trainings = [record(row(8, mAP=0.7)), record(row(9, mAP=0.7)), record(row(8, "c", mAP=0.1))]
    others = [record(row(seed, mAP=0.7), alpha=0.5) for seed in (7, 8)]
    alone = [
        record(row(8, mAP=0.7), alpha=2.5),
        record(replace(row(8), refinement="views"), alpha=2.5),
    ]
    figures = repeated_figures([*trainings, *others, *alone])
    shown = re.findall(r"!\[[LE].*\]\((.*)\)", page(*trainings, *others, *alone))
    assert shown == list(figures)
    # Curves and errors of the first scale, then of the other one with several trainings.
    assert [len(figure.legends[0].texts) for figure in figures.values()] == [2, 2, 1, 1]


def test_pictures_of_records_that_are_gone_are_removed(tmp_path: Path):
    trainings = [record(row(seed), alpha=alpha) for alpha in (0.5, 1.5) for seed in (7, 8)]
    (tmp_path / "images").mkdir()
    (tmp_path / "images/binned_errors.png").write_bytes(b"of the recorded run")
    results_page.draw(repeated_figures(trainings), tmp_path)
    results_page.draw(kept := repeated_figures(trainings[2:]), tmp_path)
    assert {path.name for path in (tmp_path / "images").iterdir()} == {
        "binned_errors.png", *(Path(name).name for name in kept)
    }  # fmt: skip


def test_the_page_shows_sweeps():
    text = page(sweeps={"weights": [["loss.alpha", "tip_mm"], ["0.5", "4.5"], ["1.5", ""]]})
    assert "### weights\n\n![Settings and metrics](images/sweep-weights.png)\n\n" in text
    assert "| loss.alpha | tip_mm |\n| --- | --- |\n| 0.5 | 4.5 |\n| 1.5 | - |" in text
    assert "## Sweeps" not in page()


def test_a_page_elsewhere_links_to_the_documentation():
    text = page(record(row(7)), record(row(8)))
    assert "[ablation.md](../docs/ablation.md)" in text
    assert "![Binned errors](../docs/images/binned_errors.png)" in text
    assert "![Learning curves](images/curves_" in text  # drawn beside the page


def test_the_page_shows_benchmarks():
    assert "| machine.cores | 2 |" in page()
    assert "s:\n\n| a |\n| --- |\n| 1 |" in page()


def test_the_recorded_report_is_read_as_it_was_written(tmp_path: Path):
    rows = [row(7, mAP=0.5), repeated([row(7, "c", mAP=0.1), row(8, "c", mAP=0.3)])]
    report = AblationReport(
        rows, {"mAP": 0.0}, "stand-in", Champion("d", False, "the best one"), "smoke"
    )
    write_json(tmp_path / "reports/ablation.json", json.loads(to_json(report)))
    assert results_page.report_of(tmp_path) == report


@pytest.mark.parametrize("content", ["{", "{}"])
def test_a_damaged_or_old_report_is_named_with_its_remedy(content: str, tmp_path: Path):
    (tmp_path / "reports").mkdir()
    (tmp_path / "reports/ablation.json").write_text(content)
    with pytest.raises(InputError, match=r"reports/ablation\.json: .*; run `make report`$"):
        results_page.report_of(tmp_path)
