"""The stage `report` with results of other stages."""

from dataclasses import asdict
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from shaftpose.core.files import write_json
from shaftpose.metrics.silhouette_iou import SilhouetteScore
from shaftpose.report import writing
from shaftpose.report.ablation import variant_row
from tests.evaluations import accuracy, evaluation, with_real

# Text after a variant's title in the legends.
FIGURE_LABELS = {"precision_and_recall": " (AP 0.500)", "learning_curves": "", "binned_errors": ""}
RESULTS = {
    "d": evaluation("D"), "d_noise_real": evaluation("D + noise + real", with_real("real")),
}  # fmt: skip


def test_fitted_poses_have_rows_of_their_own(tmp_path: Path) -> None:
    results = {"e": evaluation("E", fitted=accuracy(mAP=0.75)), "d": RESULTS["d"]}
    rows = [variant_row(name, values) for name, values in writing.with_fits(results).items()]
    assert [(row.variant, row.title, row.metrics["mAP"]) for row in rows] == [
        ("e", "E", 0.5), ("e+fit", "E + fit", 0.75), ("d", "D", 0.5),
    ]  # fmt: skip
    own, fitted = (asdict(SilhouetteScore(1.0, iou, 2, 3)) for iou in (0.5, 0.75))
    scores = {"e": {"rendered/clear": own, "fitted/rendered/clear": fitted},
              "d": {"rendered/clear": own}}  # fmt: skip
    for name, sets in scores.items():
        write_json(tmp_path / name / "silhouette.json", sets)
    assert writing.read_silhouettes(tmp_path, ["e", "d"]) == {
        "e": {"rendered/clear": own},
        "e+fit": {"rendered/clear": fitted},
        "d": {"rendered/clear": own},
    }


def test_only_variants_with_a_real_share_mix_images_in() -> None:
    rows = [variant_row(name, values) for name, values in RESULTS.items()]
    assert [row.mixed_in_images for row in rows] == [0, 2]
    assert [row.training_images for row in rows] == [90, 90]


@pytest.mark.parametrize("domain", ["real", "stand-in"])
def test_every_figure_says_what_was_mixed_in(
    domain: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: dict[str, Figure] = {}
    monkeypatch.setattr(
        writing, "save_figure", lambda figure, path: drawn.update({path.stem: figure})
    )
    rows = [variant_row(name, values) for name, values in RESULTS.items()]
    files = writing.draw_figures(RESULTS, rows, {}, domain, tmp_path)
    assert {path.stem for path in files.values()} == drawn.keys()
    for name, end in FIGURE_LABELS.items():
        labels = [text.get_text() for text in drawn[name].legends[0].get_texts()]
        assert labels == [f"D{end}", f"D + noise + {domain}{end}"]
    ticks = [tick.get_text() for tick in drawn["ablation"].axes[0].get_yticklabels()]
    assert ticks == ["D", f"D + noise + {domain}"]
