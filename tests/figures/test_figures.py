"""Figures show the numbers they are given and are saved reproducibly."""

from pathlib import Path

import numpy as np

from shaftpose.figures.accuracy_figures import pose_error_figure, precision_recall_figure
from shaftpose.figures.style import save_figure
from shaftpose.figures.variant_figures import learning_curve_figure
from shaftpose.metrics.detection.precision_recall import PrecisionRecall
from shaftpose.metrics.pose_errors import errors_between
from shaftpose.report.ablation import VariantRow
from shaftpose.report.ablation_figure import ablation_figure


def row(variant: str, **metrics: float | None) -> VariantRow:
    return VariantRow(variant, metrics, 900, 100, 3000, 16, 0.25, 0.5, "muon", 700, (0,), 1_000)


def test_precision_recall_names_the_average_precision():
    curve = PrecisionRecall(np.array([0.5, 1.0]), np.array([1.0, 0.5]), np.array([0.9, 0.8]))
    figure = precision_recall_figure({"D": curve})
    assert figure.legends[0].get_texts()[0].get_text() == "D (AP 0.750)"
    np.testing.assert_array_equal(figure.axes[0].lines[0].get_ydata(), [1.0, 0.5])


def test_pose_errors_show_the_median_of_each_bin():
    # Two groups of true x, far apart: medians 1 and 3 in the first and the last bin.
    true = np.array([[x, 0, 20, 70, 0] for x in (-12, -12, -12, 12, 12, 12)], dtype=float)
    predicted = true + np.array([[x, 0, 0, 0, 0] for x in (1, 1, 9, -3, 3, 0)], dtype=float)
    axes = pose_error_figure(errors_between(predicted, true)).axes[0]
    np.testing.assert_allclose(axes.lines[0].get_xydata(), [[-11, 1], [11, 3]])


def test_pose_errors_without_matches_say_so():
    figure = pose_error_figure(errors_between(np.empty((0, 5)), np.empty((0, 5))))
    assert figure.axes[0].texts[0].get_text() == "no matched instrument"


def test_learning_curves_have_a_panel_for_each_name():
    rows = [(20, "loss", 1.0), (10, "loss", 2.0), (10, "mAP", 0.1)]
    figure = learning_curve_figure({"C": [rows, rows[1:]], "D": [rows[:2]]})
    assert [axes.get_ylabel() for axes in figure.axes] == ["loss", "mAP"]
    first, repeat, other = figure.axes[0].lines
    np.testing.assert_array_equal(other.get_xydata(), [[10, 2], [20, 1]])
    assert first.get_color() == repeat.get_color() != other.get_color()
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["C", "D"]


def test_ablation_bars_stand_beside_the_paper():
    rows = [row("c", mAP=0.7), row("own", mAP=None), row("d", mAP=None)]
    figure = ablation_figure(rows, {"mAP": 0.01}, "real")
    axes = figure.axes[0]
    assert [tick.get_text() for tick in axes.get_yticklabels()] == ["C", "own", "D"]
    assert axes.patches[0].get_width() == 0.7
    np.testing.assert_array_equal(axes.lines[0].get_xdata(), [0.958, np.nan, 0.949])
    assert list(axes.lines[1].get_xdata()) == [0.01, 0.01]
    assert [(text.get_text(), text.xy) for text in axes.texts] == [
        ("n/a", (0, 1)),
        ("n/a", (0.949, 2)),  # next to the paper's mark
    ]


def test_ablation_names_stand_ins():
    figure = ablation_figure([row("d_noise_real", mAP=0.7)], {}, "stand-in")
    (tick,) = figure.axes[0].get_yticklabels()
    assert tick.get_text() == "D + noise + stand-in"


def test_saved_figures_are_the_same_bytes(tmp_path: Path):
    rows = [row("c", mAP=0.7), row("d_noise_real", mAP=0.8)]
    for name in ("a", "b"):
        save_figure(ablation_figure(rows, {}, "stand-in"), tmp_path / name / "figure.png")
    first, second = ((tmp_path / name / "figure.png").read_bytes() for name in ("a", "b"))
    assert first == second
    assert b"Software" not in first
