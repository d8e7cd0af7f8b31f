import numpy as np
import pytest

from shaftpose.sweeps.jobs import SweepJob, swept_parameters
from shaftpose.sweeps.lines import line_figure

JOBS = [
    SweepJob({"loss.alpha": alpha, "loss.gamma": gamma, "seed": "7"}, {"mAP": m, "tip_mm": tip})
    for alpha, gamma, m, tip in (
        ("0.5", "5.0", 0.2, 9.0),
        ("10.0", "5.0", 0.6, 5.0),
        ("1.5", "1.0", 0.3, 6.0),
    )
]


def lines(jobs: list[SweepJob]) -> np.ndarray:
    """Heights (jobs, axes) of each job's line as drawn, without the axes (lines of 2 points)."""
    axes = line_figure(jobs, ["mAP", "tip_mm"]).axes[0]
    return np.stack([line.get_ydata() for line in axes.lines if len(line.get_ydata()) > 2])


def test_what_is_swept_is_what_differs() -> None:
    assert swept_parameters(JOBS) == ["loss.alpha", "loss.gamma"]


def test_of_a_variant_its_name_stands_for_the_rest_of_its_file() -> None:
    def job(name: str, noise: str) -> SweepJob:
        return SweepJob({"variant.name": name, "variant.noise": noise, "seed": noise}, {})

    assert swept_parameters([job("c", "0"), job("d", "5")]) == ["seed", "variant.name"]
    several = [job("c", "0"), job("d", "5"), job("d", "9")]
    assert swept_parameters(several) == ["seed", "variant.name", "variant.noise"]
    assert swept_parameters(several[1:]) == ["seed", "variant.noise"]


def test_what_a_variants_file_takes_from_elsewhere_is_named_once() -> None:
    jobs = [SweepJob({"loss.alpha": a, "variant.loss.alpha": a}, {}) for a in ("1", "2")]
    assert swept_parameters(jobs) == ["loss.alpha"]


def test_lines_pass_the_axes_where_their_values_are() -> None:
    # Worst first: mAP 0.2, 0.3, 0.6. alpha has the levels 0.5 < 1.5 < 10, gamma 1 < 5.
    low, high = 0.04, 0.96
    quarter = low + (high - low) / 4
    expected = [
        [low, high, low, high],
        [0.5, low, quarter, quarter],
        [high, high, high, low],
    ]
    assert lines(JOBS) == pytest.approx(np.array(expected))


def test_the_ends_of_each_axis_are_written() -> None:
    axes = line_figure(JOBS, ["mAP", "tip_mm"]).axes[0]
    written = {text.get_text() for text in axes.texts}
    assert {"loss.alpha", "0.5", "1.5", "10.0", "mAP", "0.2", "0.4", "0.6", "9"} <= written


def test_what_a_job_lacks_is_a_dash_on_top() -> None:
    jobs = [
        SweepJob({"variant.name": "d"}, {"mAP": 0.0}),
        SweepJob({"variant.name": "b", "widths": "5"}, {"mAP": 0.5, "tip_mm": 8.0}),
        SweepJob({"variant.name": "d"}, {"mAP": 1.0, "tip_mm": 6.0}),
    ]
    low, high = 0.04, 0.96
    expected = [[high, high, low, high], [low, low, 0.5, 0.84], [high, high, high, low]]
    assert lines(jobs) == pytest.approx(np.array(expected))
    texts = line_figure(jobs, ["mAP", "tip_mm"]).axes[0].texts
    dashes = [(*text.get_position(),) for text in texts if text.get_text() == "-"]
    assert dashes == [(pytest.approx(1.04), high), (pytest.approx(3.04), high)]


def test_a_sweep_that_found_nothing_is_drawn() -> None:
    jobs = [SweepJob({"seed": seed}, {"mAP": 0.0}) for seed in "12"]
    assert lines(jobs) == pytest.approx(np.array([[0.04, 0.04, 0.96], [0.96, 0.04, 0.96]]))
