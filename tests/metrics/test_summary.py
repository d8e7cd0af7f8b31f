"""Intervals and spreads of a test set."""

import numpy as np
import pytest

from shaftpose.core.instruments import Annotations, Detections
from shaftpose.metrics.detection.precision_recall import (
    average_precision,
    precision_recall,
    resampled_average_precision,
)
from shaftpose.metrics.metrics import compared, evaluate
from shaftpose.metrics.pose_errors import pose_errors
from shaftpose.metrics.summary import interval, mean_interval, summary

BOXES = np.array([[0.0, 0.0, 10.0, 10.0], [50.0, 50.0, 80.0, 80.0]])
POSE = np.array([5.0, 5.0, 20.0, 70.0, 100.0])


def images(count: int) -> tuple[list[Detections], list[Annotations]]:
    """Images with one or two instruments, found with errors, missed or invented at random."""
    rng = np.random.default_rng(8)
    found, known = [], []
    for n in range(count):
        shown = BOXES[: 1 + n % 2]
        poses = np.tile(POSE, (len(shown), 1))
        known.append(Annotations(shown, poses))
        boxes = np.concatenate([shown, BOXES[:1] + 100])[rng.random(len(shown) + 1) < 0.8]
        wrong = np.tile(POSE, (len(boxes), 1)) + rng.normal(0, 1, (len(boxes), 5))
        found.append(Detections(boxes, np.sort(rng.random(len(boxes)))[::-1], wrong))
    return found, known


def test_resampled_precision_is_that_of_the_drawn_images() -> None:
    found, known = images(12)
    resampled = resampled_average_precision(found, known)
    rng = np.random.default_rng(2)
    for drawn in (np.arange(12), *(rng.integers(12, size=12) for _ in range(20))):
        chosen = [found[n] for n in drawn], [known[n] for n in drawn]
        assert resampled(drawn) == pytest.approx(average_precision(precision_recall(*chosen)))
    assert resampled(np.empty(0, dtype=np.intp)) is None


def test_intervals_surround_the_metrics() -> None:
    found, known = images(60)
    metrics, errors = evaluate(found, known, 0.3), pose_errors(found, known, 0.3)
    further = {"twice_mm": 2 * errors.tip_mm}
    result = summary(compared(found, known, 0.3), further)
    for name, ends in (("mAP", result.mAP), ("detected_rate", result.detected_rate)):
        assert ends is not None
        assert ends[0] < metrics[name] < ends[1]
    tip, twice = result.errors["tip_mm"], result.errors["twice_mm"]
    assert tip.mean == pytest.approx(metrics["tip_mm"])
    assert tip.interval[0] < tip.mean < tip.interval[1]
    assert tip.median == pytest.approx(np.median(errors.tip_mm))
    assert tip.p95 == pytest.approx(np.quantile(errors.tip_mm, 0.95))
    assert twice.interval == pytest.approx((2 * tip.interval[0], 2 * tip.interval[1]))
    half = evaluate(found, known, 0.5)["detected_rate"]
    assert result.detected_rate_at_half == half


def test_intervals_of_images_with_one_instrument_are_those_of_means() -> None:
    known = [Annotations(BOXES[:1], POSE[None]) for _ in range(9)]
    off = np.arange(9.0)  # mm; the last three are missed
    scores = np.repeat([0.9, 0.4, 0.1], 3)
    found = [
        Detections(BOXES[:1], np.array([score]), (POSE + [0, 0, mm, 0, 0])[None])
        for score, mm in zip(scores, off, strict=True)
    ]
    result = summary(compared(found, known, 0.3), {})
    hits = (scores >= 0.3).astype(float).tolist()
    assert result.detected_rate == pytest.approx(mean_interval(hits))
    assert result.detected_rate_at_half == pytest.approx(3 / 9)
    z = result.errors["z_mm"]
    assert (z.mean, z.median, z.p95) == pytest.approx((2.5, 2.5, 4.75))
    # Draws of images, of which those without a detection have no error.
    drawn = interval(9, lambda images: float(off[images[images < 6]].mean()))
    assert z.interval == pytest.approx(drawn)


def test_a_set_in_which_nothing_is_found_has_no_errors() -> None:
    nothing = Detections(np.empty((0, 4)), np.empty(0), np.empty((0, 5)))
    known = [Annotations(BOXES, np.tile(POSE, (2, 1)))]
    result = summary(compared([nothing], known), {})
    assert result.errors == {}
    assert (result.mAP, result.detected_rate) == ((0, 0), (0, 0))


def test_a_means_interval_is_that_of_the_normal_theory() -> None:
    values = np.random.default_rng(3).normal(10, 2, size=400)
    found = mean_interval(values.tolist())
    assert found is not None
    half = 1.96 * values.std() / 20
    assert found == pytest.approx((values.mean() - half, values.mean() + half), abs=0.03)


def test_equal_values_have_no_spread_and_runs_agree() -> None:
    assert mean_interval([0.5] * 7) == (0.5, 0.5)
    assert mean_interval([0.0, 1.0, 3.0]) == mean_interval([0.0, 1.0, 3.0])


def test_undefined_statistics_have_no_interval() -> None:
    assert mean_interval([]) is None
    assert interval(3, lambda drawn: None) is None
    # Undefined where image 0 is not drawn: the others decide.
    found = interval(3, lambda drawn: 1.0 if 0 in drawn else None)
    assert found == (1.0, 1.0)
