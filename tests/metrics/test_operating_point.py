"""The confidence threshold."""

import numpy as np

from shaftpose.metrics.detection.average_precision import PrecisionRecall
from shaftpose.metrics.detection.operating_point import best_confidence


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
