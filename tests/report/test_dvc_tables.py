"""The tables that DVC shows of a report."""

import csv
import json
from dataclasses import replace
from pathlib import Path

from shaftpose.evaluation.results import Silhouettes
from shaftpose.metrics.image_metrics import SilhouetteScore
from shaftpose.report.ablation import AblationReport, variant_rows
from shaftpose.report.champion import Champion
from shaftpose.report.dvc_tables import write_dvc_tables
from tests.evaluations import accuracy, evaluation

FITTED = evaluation("E", refined=accuracy(mAP=0.75))
OTHER = replace(evaluation("D"), curves=[(2, "validation/mAP", 0.5), (3, "train/box", 1.0)])


def table(path: Path) -> list[list[str]]:
    return list(csv.reader(path.read_text().splitlines()))


def test_dvc_shows_seven_numbers_of_the_best_variant_and_compares_all(tmp_path: Path) -> None:
    score = SilhouetteScore(1.0, 0.25, 2, 3)
    silhouettes = Silhouettes(
        {"rendered/clear": score}, {"rendered/clear": replace(score, iou=0.5)}
    )
    rows = [*variant_rows("e", FITTED, silhouettes), *variant_rows("d", OTHER)]
    report = AblationReport(rows, {}, "stand-in", Champion("e", True, "rule"), "demo")
    write_dvc_tables(report, {"e": FITTED, "d": OTHER}, tmp_path)
    best = json.loads((tmp_path / "metrics.json").read_text())
    assert len(best) == 7
    assert (best["mAP"], best["iou"]) == (0.75, 0.5)
    names, *variants = table(tmp_path / "plots/variants.csv")
    assert names[:2] == ["variant", "mAP"]
    assert [row[:2] for row in variants] == [["E", "0.5"], ["E + fit", "0.75"], ["D", "0.5"]]
    assert table(tmp_path / "plots/mAP.csv") == [
        ["step", "e", "d"], ["1", "0.1", ""], ["2", "0.25", "0.5"],
    ]  # fmt: skip
    assert table(tmp_path / "plots/tip_mm.csv") == [["step", "e", "d"]]


def test_a_variants_metrics_are_those_of_fitted_poses_under_its_name() -> None:
    known = FITTED.headlines("e")
    assert known["e/mAP"] == 0.75
    assert len(known) == 9
