"""Boxes, average precision, detected rate and the confidence threshold by hand."""

from collections.abc import Sequence

import numpy as np
import pytest

from shaftpose.core.instruments import Annotations, Detections
from shaftpose.metrics.detection.matching import (
    best_instruments,
    box_iou,
    detected_rate,
    nearest_pairs,
)
from shaftpose.metrics.detection.precision_recall import (
    PrecisionRecall,
    average_precision,
    best_confidence,
    precision_recall,
)

LEFT, RIGHT, FAR = [0, 0, 10, 10], [50, 0, 60, 10], [200, 200, 210, 210]


def known(*boxes: Sequence[float]) -> Annotations:
    return Annotations(np.array(boxes, dtype=float).reshape(-1, 4), None)


def found(*scored_boxes: tuple[float, Sequence[float]]) -> Detections:
    boxes = np.array([box for _, box in scored_boxes], dtype=float).reshape(-1, 4)
    scores = np.array([score for score, _ in scored_boxes], dtype=float)
    return Detections(boxes, scores, np.zeros((len(scores), 5)))


def test_box_iou_by_hand():
    # 10 x 10 against itself shifted by 5: 50 of 150; against its left half: 50 of 100; apart: 0.
    others = np.array([[5, 0, 15, 10], [0, 0, 5, 10], FAR], dtype=float)
    overlap = box_iou(np.array([LEFT], dtype=float), others)
    np.testing.assert_allclose(overlap, [[1 / 3, 1 / 2, 0]])


def test_box_iou_of_empty_boxes_is_zero():
    empty = np.array([[3.0, 3.0, 3.0, 3.0]])
    assert box_iou(empty, empty) == 0
    assert box_iou(np.empty((0, 4)), empty).shape == (0, 1)


def test_a_box_belongs_to_the_instrument_it_overlaps_most():
    box = np.array([[0, 0, 10, 8]], dtype=float)
    instruments = np.array([[0, 0, 10, 14], LEFT], dtype=float)
    assert best_instruments(box, instruments).tolist() == [1]
    assert best_instruments(box / [1, 1, 1, 2], instruments).tolist() == [-1]


# Three instruments in two images; detections of both images by descending score:
#   0.9 LEFT of image 0            right   precision 1/1   recall 1/3
#   0.8 LEFT again                 wrong             1/2          1/3
#   0.7 no instrument, image 1     wrong             1/3          1/3
#   0.6 RIGHT of image 0           right             2/4          2/3
#   0.5 LEFT of image 1            right             3/5          3/3
# The envelope is 1 up to recall 1/3, then 3/5: AP = (1 + 3/5 + 3/5) / 3 = 11/15. Without the
# envelope it would be 0.7, with the 11 points of VOC 2007 (4 + 7 * 3/5) / 11 = 0.745.
WORKED_TRUTH = [known(LEFT, RIGHT), known(LEFT)]
WORKED_FINDS = [
    found((0.9, LEFT), (0.8, [0, 0, 10, 9]), (0.6, RIGHT)),
    found((0.7, FAR), (0.5, LEFT)),
]


def test_average_precision_of_a_worked_example():
    curve = precision_recall(WORKED_FINDS, WORKED_TRUTH)
    np.testing.assert_allclose(curve.scores, [0.9, 0.8, 0.7, 0.6, 0.5])
    np.testing.assert_allclose(curve.recall, [1 / 3, 1 / 3, 1 / 3, 2 / 3, 1])
    np.testing.assert_allclose(curve.precision, [1, 1 / 2, 1 / 3, 1 / 2, 3 / 5])
    assert average_precision(curve) == pytest.approx(11 / 15)


def test_half_of_the_union_has_to_overlap():
    enough, too_little = [found((0.9, [0, 0, 10, 5]))], [found((0.9, [0, 0, 10, 4.9]))]
    assert average_precision(precision_recall(enough, [known(LEFT)])) == 1
    assert average_precision(precision_recall(too_little, [known(LEFT)])) == 0


def test_a_second_detection_costs_precision_but_not_the_detected_rate():
    # The copy outscores RIGHT: right, wrong, right gives AP = (1 + 2/3) / 2.
    truth = [known(LEFT, RIGHT)]
    twice = [found((0.9, LEFT), (0.8, LEFT), (0.7, RIGHT))]
    once = [found((0.9, LEFT), (0.7, RIGHT))]
    assert average_precision(precision_recall(once, truth)) == 1
    assert average_precision(precision_recall(twice, truth)) == pytest.approx(5 / 6)
    assert detected_rate(twice, truth) == detected_rate(once, truth) == 1


def test_no_detections_score_zero():
    truth, nothing = [known(LEFT), known(RIGHT)], [found(), found()]
    assert average_precision(precision_recall(nothing, truth)) == 0
    assert detected_rate(nothing, truth) == 0


def test_recall_that_is_never_reached_adds_no_area():
    truth = [known(LEFT, RIGHT)]
    assert average_precision(precision_recall([found((0.9, LEFT))], truth)) == 0.5


def test_detected_rate_counts_instruments_above_the_confidence():
    # Two of four instruments are detected: one score is below 0.5, one overlap is too small.
    truth = [known(LEFT, RIGHT), known(LEFT), known(LEFT)]
    finds = [
        found((0.9, LEFT), (0.5, RIGHT)),
        found((0.49, LEFT)),
        found((0.9, [5, 0, 15, 10])),
    ]
    assert detected_rate(finds, truth) == 0.5
    assert detected_rate(finds, truth, confidence=0.4) == 0.75


def test_one_box_finds_only_one_of_two_crossing_shafts():
    # True boxes of 10 x 10 and 10 x 8 at the same place. A box of 10 x 9 has an IoU of 9/10 and 8/9
    # with them; a box of 10 x 8 equals the second one.
    truth = [known(LEFT, [0, 0, 10, 8])]
    between, second = (0.9, [0, 0, 10, 9]), (0.8, [0, 0, 10, 8])
    assert detected_rate([found(between)], truth) == 0.5
    assert detected_rate([found(between, between)], truth) == 0.5
    assert detected_rate([found(between, second)], truth) == 1


def test_detected_rate_without_instruments_is_undefined():
    assert detected_rate([found((0.9, LEFT))], [known()]) is None


def test_best_confidence_is_the_score_of_the_best_f1():
    # Four instruments; detections are right, right, wrong, right, wrong:
    # F1 = 2 * hits / (detections + 4) = 2/5, 4/6, 4/7, 6/8, 6/9.
    curve = PrecisionRecall(
        recall=np.array([1, 2, 2, 3, 3]) / 4,
        precision=np.array([1, 2, 2, 3, 3]) / np.arange(1, 6),
        scores=np.array([0.9, 0.8, 0.7, 0.3, 0.2]),
    )
    assert best_confidence(curve) == 0.3


def test_nothing_right_leaves_one_half():
    nothing = PrecisionRecall(np.empty(0), np.empty(0), np.empty(0))
    wrong = PrecisionRecall(np.zeros(2), np.zeros(2), np.array([0.9, 0.1]))
    assert best_confidence(nothing) == 0.5
    assert best_confidence(wrong) == 0.5


def test_the_nearest_are_paired_first() -> None:
    """Row 0 is near both columns, but column 0 is nearer to row 1; row 2 is too far from all."""
    distances = np.array([[2.0, 3.0], [1.0, 5.0], [9.0, 9.0]])
    assert nearest_pairs(distances, 4.0) == {1: 0, 0: 1}
    assert nearest_pairs(distances, 3.0) == {1: 0, 0: 1}
    assert nearest_pairs(distances, 2.9) == {1: 0}
    assert nearest_pairs(distances, 0.9) == {}


def test_what_is_infinitely_far_or_no_number_has_no_partner() -> None:
    assert nearest_pairs(np.array([[np.inf, np.nan, 1.0]]), np.inf) == {0: 2}


@pytest.mark.parametrize("shape", [(0, 0), (0, 3), (2, 0)])
def test_nothing_has_no_pairs(shape: tuple[int, int]) -> None:
    assert nearest_pairs(np.zeros(shape), 1.0) == {}
