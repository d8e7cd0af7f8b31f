"""The stage `report` with results of other stages."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from shaftpose.evaluation.binned_errors import as_plain, binned_errors
from shaftpose.evaluation.pose_errors import errors_between
from shaftpose.json_files import write_json
from shaftpose.report import writing
from shaftpose.report.ablation import variant_row
from shaftpose.settings.parts import PoseRanges

RANGES = PoseRanges(
    x_mm=(-20, 20), y_mm=(-20, 20), z_mm=(10, 40), pitch_deg=(50, 90), yaw_deg=(0, 358)
)
POSES = np.array([[0.0, 0.0, 20.0, 70.0, 100.0]])
ERRORS = errors_between(POSES + 1, POSES)


def result(title: str, real: dict[str, Any] | None) -> dict[str, Any]:
    """The content of an evaluation.json."""
    return {
        "title": title,
        "metrics": {"mAP": 0.5, "images": 20},
        "training": {
            "training_images": 90, "steps": 10, "batch_size": 4, "width": 0.125, "depth": 0.25,
            "seed": 7, "parameters": 1000, "real": real,
            "recipe": {"size": {"optimizer": "adam", "detector_steps": 5}},
            "variant": {"start": True},
        },
        "binned_errors": as_plain(binned_errors(ERRORS, np.ones(1), RANGES)),
        "precision_recall": {"recall": [0.5], "precision": [1.0], "scores": [0.9]},
        "curves": [[1, "validation/mAP", 0.1], [2, "validation/mAP", 0.2]],
        "fitted": None,
        "validation": {"mAP": 0.2, "tip_mm": None},
    }  # fmt: skip


# Text after a variant's title in the legends.
FIGURE_LABELS = {"precision_and_recall": " (AP 0.500)", "learning_curves": "", "binned_errors": ""}
RESULTS = {
    "d": result("D", None),
    "d_noise_real": result("D + noise + real", {"domain": "real", "images": 100}),
}


def test_fitted_poses_have_rows_of_their_own(tmp_path: Path) -> None:
    better = {"metrics": {"mAP": 0.75, "images": 20}}
    results = {"e": result("E", None) | {"fitted": better}, "d": RESULTS["d"]}
    rows = [variant_row(name, values) for name, values in writing.with_fits(results).items()]
    assert [(row.variant, row.title, row.metrics["mAP"]) for row in rows] == [
        ("e", "E", 0.5), ("e_fitted", "E + fit", 0.75), ("d", "D", 0.5),
    ]  # fmt: skip
    scores = {"e": {"rendered/clear": {"iou": 0.5}, "fitted/rendered/clear": {"iou": 0.75}},
              "d": {"rendered/clear": {"iou": 0.25}}}  # fmt: skip
    for name, sets in scores.items():
        write_json(tmp_path / name / "silhouette.json", sets)
    assert writing.read_silhouettes(tmp_path, ["e", "d"]) == {
        "e": {"rendered/clear": {"iou": 0.5}},
        "e_fitted": {"rendered/clear": {"iou": 0.75}},
        "d": {"rendered/clear": {"iou": 0.25}},
    }


def test_only_variants_with_a_real_share_mix_images_in() -> None:
    rows = [variant_row(name, values) for name, values in RESULTS.items()]
    assert [row.mixed_in_images for row in rows] == [0, 100]
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
