"""The stage `report` with results of other stages."""

from dataclasses import asdict
from pathlib import Path

import pytest

from shaftpose.core.files import write_json
from shaftpose.evaluation.results import Silhouettes
from shaftpose.metrics.image_metrics import SilhouetteScore
from shaftpose.report import writing
from shaftpose.report.ablation import AblationReport, VariantRow, variant_rows
from shaftpose.report.champion import Champion
from tests.evaluations import accuracy, evaluation, with_real

# Text after a variant's title in the legends.
FIGURE_LABELS = {"Precision and recall": " (AP 0.500)", "Learning curves": "", "Binned errors": ""}
RESULTS = {
    "d": evaluation("D"), "d_noise_real": evaluation("D + noise + real", with_real("real")),
}  # fmt: skip


def test_refined_poses_have_rows_of_their_own(tmp_path: Path) -> None:
    results = {"e": evaluation("E", refined=accuracy(mAP=0.75)), "d": RESULTS["d"]}
    own, fitted = (SilhouetteScore(1.0, iou, 2, 3) for iou in (0.5, 0.75))
    scores = {"e": Silhouettes({"rendered/clear": own}, {"rendered/clear": fitted}),
              "d": Silhouettes({"rendered/clear": own})}  # fmt: skip
    for name, sets in scores.items():
        write_json(tmp_path / name / "silhouette.json", asdict(sets))
    assert writing.read_silhouettes(tmp_path, ["e", "d"]) == scores
    rows = writing.all_rows(results, scores)
    assert [(row.variant, row.refined, row.metrics["mAP"]) for row in rows] == [
        ("e", False, 0.5), ("e", True, 0.75), ("d", False, 0.5),
    ]  # fmt: skip
    assert [row.silhouettes["rendered/clear"]["iou"] for row in rows] == [0.5, 0.75, 0.5]


def rows_of_results() -> list[VariantRow]:
    return [row for name, one in RESULTS.items() for row in variant_rows(name, one)]


def test_only_variants_with_a_real_share_mix_images_in() -> None:
    rows = rows_of_results()
    assert [row.mixed_in_images for row in rows] == [0, 2]
    assert [row.training_images for row in rows] == [90, 90]


@pytest.mark.parametrize("domain", ["real", "stand-in"])
def test_every_figure_says_what_was_mixed_in(domain: str) -> None:
    report = AblationReport(rows_of_results(), {}, domain, Champion("d", False, "rule"), "demo")
    drawn = writing.report_figures(report, RESULTS)
    for name, end in FIGURE_LABELS.items():
        labels = [text.get_text() for text in drawn[name].legends[0].get_texts()]
        assert labels == [f"D{end}", f"D + noise + {domain}{end}"]
    ticks = [tick.get_text() for tick in drawn["Ablation"].axes[0].get_yticklabels()]
    assert ticks == ["D", f"D + noise + {domain}"]
