"""Pose errors, metrics of a test set and the constant predictor against hand-computed values."""

import json
from collections.abc import Sequence

import numpy as np
import pytest

from shaftpose.core.errors import InputError
from shaftpose.core.instruments import Annotations, Detections
from shaftpose.metrics.metrics import constant_predictor, evaluate
from shaftpose.metrics.pose_errors import (
    FoundInstruments,
    errors_between,
    found_instruments,
    pose_errors,
)

LEFT, RIGHT, FAR = [0, 0, 10, 10], [50, 0, 60, 10], [200, 200, 210, 210]
POSE = [1.0, 2.0, 20.0, 70.0, 100.0]


def array(*rows: Sequence[float] | np.ndarray) -> np.ndarray:
    return np.array(rows, dtype=float)


def test_yaw_takes_the_short_way_over_the_seam():
    true = array([0, 0, 20, 90, 358], [0, 0, 20, 90, 2], [0, 0, 20, 90, 10])
    predicted = array([0, 0, 20, 90, 2], [0, 0, 20, 90, 358], [0, 0, 20, 90, 190])
    errors = errors_between(predicted, true)
    np.testing.assert_allclose(errors.differences[:2, 4], [4, -4])
    np.testing.assert_allclose(errors.absolute[:, 4], [4, 4, 180])
    # At pitch 90 deg the shaft is in the image plane: the axis error equals the yaw error.
    np.testing.assert_allclose(errors.axis_deg, [4, 4, 180], atol=1e-9)


def test_axis_and_tip_errors_by_hand():
    # Pitch 60, yaw 0 against 180: (s, 0, -c) and (-s, 0, -c) with s^2 = 3/4 and c^2 = 1/4:
    # cos = -3/4 + 1/4 = -1/2, so 120 deg. Pitch 90, yaw 0 and 90: perpendicular.
    true = array([0, 0, 20, 60, 0], [1, 1, 20, 90, 0])
    predicted = array([3, 4, 20, 60, 180], [2, 3, 18, 90, 90])
    errors = errors_between(predicted, true)
    np.testing.assert_allclose(errors.axis_deg, [120, 90])
    np.testing.assert_allclose(errors.tip_mm, [5, 3])
    np.testing.assert_allclose(errors.differences[1], [1, 2, -2, 0, 90])


def test_the_best_score_speaks_for_an_instrument_found_twice():
    truth = [Annotations(array(LEFT), array(POSE))]
    good, bad = np.array(POSE) + [1, 0, 0, 0, 0], np.array(POSE) + [9, 0, 0, 0, 0]
    # Unsorted, with the worse box first: only the score decides.
    finds = Detections(array(LEFT, [0, 0, 10, 8]), np.array([0.6, 0.9]), array(bad, good))
    errors = pose_errors([finds], truth)
    np.testing.assert_allclose(errors.differences, [[1, 0, 0, 0, 0]])
    np.testing.assert_allclose(errors.true_poses, [POSE])


def test_each_detection_is_paired_in_its_own_image():
    other = [-5.0, 3.0, 30.0, 80.0, 10.0]
    truth = [Annotations(array(LEFT), array(POSE)), Annotations(array(RIGHT, LEFT),
                                                               array(POSE, other))]  # fmt: skip
    nothing = Detections(np.empty((0, 4)), np.empty(0), np.empty((0, 5)))
    finds = [nothing, Detections(array(LEFT, FAR), np.array([0.9, 0.8]), array(other, POSE))]
    errors = pose_errors(finds, truth)
    np.testing.assert_allclose(errors.true_poses, [other])
    np.testing.assert_allclose(errors.differences, np.zeros((1, 5)))


def test_images_without_poses_are_passed_over():
    truth = [Annotations(array(LEFT), None), Annotations(array(LEFT), array(POSE))]
    find = Detections(array(LEFT), np.array([0.9]), array(POSE))
    assert len(pose_errors([find, find], truth).tip_mm) == 1


def test_evaluate_gives_every_name_of_the_conventions():
    truth = [Annotations(array(LEFT, RIGHT), array(POSE, POSE))]
    guesses = array(np.array(POSE) + [1, -2, 2, 3, -4], POSE)
    finds = [Detections(array(LEFT, FAR), np.array([0.9, 0.2]), guesses)]
    metrics = dict(evaluate(finds, truth))
    # Great circle between pitches 70 and 73 deg whose yaws are 4 deg apart, by the haversine:
    # sin^2(a / 2) = sin^2(1.5 deg) + sin(70 deg) sin(73 deg) sin^2(2 deg), so a = 4.8357 deg.
    assert metrics.pop("axis_deg") == pytest.approx(4.8357, abs=1e-4)
    assert metrics == {
        "mAP": 0.5, "detected_rate": 0.5, "x_mm": 1, "y_mm": 2, "z_mm": 2, "pitch_deg": 3,
        "yaw_deg": 4, "tip_mm": 3, "images": 1, "instruments": 2, "detections": 1,
        "confidence": 0.5,
    }  # fmt: skip


def test_unmatched_metrics_are_null_and_never_nan():
    truth = [Annotations(array(LEFT), array(POSE))]
    nothing = [Detections(np.empty((0, 4)), np.empty(0), np.empty((0, 5)))]
    content = json.loads(json.dumps(evaluate(nothing, truth), allow_nan=False))
    assert content["mAP"] == content["detected_rate"] == 0
    assert all(content[name] is None for name in ("x_mm", "yaw_deg", "axis_deg", "tip_mm"))


def test_an_image_without_a_shaft_costs_precision_and_no_rate():
    # Right, wrong (in the empty image), right: precision 1, 1/2, 2/3 at recall 1/2, 1/2, 1, so the
    # AP is (1 + 2/3) / 2. Both shafts are detected, and the errors are theirs.
    empty = Annotations(np.empty((0, 4)), np.empty((0, 5)))
    shown = Annotations(array(LEFT), array(POSE))
    find, alarm, late = (
        Detections(array(LEFT), np.array([s]), array(POSE)) for s in (0.9, 0.8, 0.7)
    )
    metrics = evaluate([find, alarm, late], [shown, empty, shown])
    assert metrics["mAP"] == pytest.approx(5 / 6)
    assert (metrics["detected_rate"], metrics["tip_mm"]) == (1, 0)
    assert (metrics["images"], metrics["instruments"], metrics["detections"]) == (3, 2, 3)
    nothing = Detections(np.empty((0, 4)), np.empty(0), np.empty((0, 5)))
    assert evaluate([find, nothing, late], [shown, empty, shown])["mAP"] == 1


def test_detections_of_images_that_are_not_known_are_refused():
    shown, find = (
        Annotations(array(LEFT), array(POSE)),
        Detections(array(LEFT), np.ones(1), array(POSE)),
    )
    with pytest.raises(InputError, match="2 images have detections and 1 annotations"):
        evaluate([find, find], [shown])


def test_a_test_set_without_instruments_has_no_rates():
    empty = Annotations(np.empty((0, 4)), np.empty((0, 5)))
    find = Detections(array(LEFT), np.array([0.9]), array(POSE))
    metrics = evaluate([find], [empty])
    assert (
        metrics["mAP"] is None and metrics["detected_rate"] is None and metrics["detections"] == 1
    )


def test_constant_predictor_by_hand():
    # Mean box [1, 0, 11, 10], mean pose (2, 0, 20, 70) and yaw 0, the mean of 350 and 10 deg.
    train = [
        Annotations(array([0, 0, 10, 10]), array([0, 0, 10, 60, 350])),
        Annotations(array([2, 0, 12, 10]), array([4, 0, 30, 80, 10])),
    ]
    test = [
        Annotations(array([1, 0, 11, 10], FAR), array([2, 0, 20, 70, 20], [6, 3, 20, 90, 180])),
        Annotations(array(FAR), array([2, 0, 14, 75, 340])),
    ]
    metrics = constant_predictor(train, test)
    # One of three instruments is hit; of two detections with equal scores the first is right.
    assert metrics["detected_rate"] == pytest.approx(1 / 3)
    assert metrics["mAP"] == pytest.approx(1 / 3)
    # Errors are over all three instruments, not only the one that was hit.
    assert metrics["x_mm"] == pytest.approx(4 / 3)
    assert metrics["y_mm"] == pytest.approx(1)
    assert metrics["z_mm"] == pytest.approx(2)
    assert metrics["pitch_deg"] == pytest.approx(25 / 3)
    assert metrics["yaw_deg"] == pytest.approx((20 + 180 + 20) / 3)
    assert metrics["tip_mm"] == pytest.approx((0 + 5 + 6) / 3)
    assert (metrics["images"], metrics["instruments"], metrics["detections"]) == (2, 3, 2)


def test_constant_predictor_needs_poses_to_average():
    boxes_only = [Annotations(array(LEFT), None)]
    with pytest.raises(InputError, match="no training image has poses"):
        constant_predictor(boxes_only, boxes_only)
    with pytest.raises(InputError, match="holds no instrument"):
        constant_predictor([], boxes_only)


ONE = np.array([[1.0, 2.0, 20.0, 70.0, 100.0]])


def test_errors_are_kept_to_the_micrometre() -> None:
    moved = ONE + np.array([[-0.30149, 0.4, 0.0, 0.0, 0.0]])
    kept = found_instruments(errors_between(moved, ONE), total=3)
    errors = {
        "x_mm": [0.301], "y_mm": [0.4], "z_mm": [0.0], "pitch_deg": [0.0], "yaw_deg": [0.0],
        "axis_deg": [0.0], "tip_mm": [0.501],
    }  # fmt: skip
    assert kept == FoundInstruments(3, [0], errors)
