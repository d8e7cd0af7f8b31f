import numpy as np
import pytest

from shaftpose.evaluation.sweep_figure import SweepJob, sweep_figure, swept_parameters

JOBS = [
    SweepJob({"loss.alpha": alpha, "loss.gamma": gamma, "seed": "7"}, {"mAP": m, "tip_mm": tip})
    for alpha, gamma, m, tip in (
        ("0.5", "5.0", 0.2, 9.0),
        ("10.0", "5.0", 0.6, 5.0),
        ("1.5", "1.0", 0.3, 6.0),
    )
]


def lines() -> list[np.ndarray]:
    """Heights (4,) at the four axes of each job's line, as drawn."""
    axes = sweep_figure(JOBS, ["mAP", "tip_mm"]).axes[0]
    return [np.asarray(line.get_ydata()) for line in axes.lines if len(line.get_ydata()) == 4]


def test_what_is_swept_is_what_differs() -> None:
    assert swept_parameters(JOBS) == ["loss.alpha", "loss.gamma"]


def test_lines_pass_the_axes_where_their_values_are() -> None:
    # Worst first: mAP 0.2, 0.3, 0.6. alpha has the levels 0.5 < 1.5 < 10, gamma 1 < 5.
    low, high = 0.04, 0.96
    quarter = low + (high - low) / 4
    expected = [
        [low, high, low, high],
        [0.5, low, quarter, quarter],
        [high, high, high, low],
    ]
    assert np.stack(lines()) == pytest.approx(np.array(expected))


def test_the_ends_of_each_axis_are_written() -> None:
    axes = sweep_figure(JOBS, ["mAP", "tip_mm"]).axes[0]
    written = {text.get_text() for text in axes.texts}
    assert {"loss.alpha", "0.5", "1.5", "10.0", "mAP", "0.2", "0.4", "0.6", "9"} <= written
