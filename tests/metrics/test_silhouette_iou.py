"""Silhouette IoU on masks small enough to count by hand."""

import numpy as np
import pytest

from shaftpose.core.errors import InputError
from shaftpose.core.instruments import Annotations, Detections
from shaftpose.metrics.silhouette_iou import SilhouetteScore, silhouette_iou, silhouette_score


def mask(*columns: int) -> np.ndarray:
    """A (4, 8) mask with these columns filled: 4 pixels each."""
    filled = np.zeros((4, 8), dtype=bool)
    filled[:, list(columns)] = True
    return filled


def test_unions_are_compared_not_pairs():
    # True columns 0-3, predicted 2-5 in overlapping pieces: 2 of 6 columns are shared.
    assert silhouette_iou([mask(0, 1), mask(2, 3)], [mask(2, 3, 4), mask(4, 5)]) == pytest.approx(
        2 / 6
    )
    assert silhouette_iou([mask(0, 1)], [mask(0), mask(1)]) == 1


def test_nothing_detected_is_zero_and_nothing_there_undefined():
    assert silhouette_iou([mask(0)], []) == 0
    assert silhouette_iou([], [mask(0)]) == 0
    assert silhouette_iou([], []) is None
    assert silhouette_iou([mask()], [mask()]) is None


def test_pixels_left_out_count_only_where_a_known_shaft_is():
    # True columns 0 and 1, predicted 1 to 4, of which 3 and 4 do not count: 1 of 3.
    true, predicted = [mask(0, 1)], [mask(1, 2), mask(3, 4)]
    assert silhouette_iou(true, predicted, mask(3, 4)) == pytest.approx(1 / 3)
    assert silhouette_iou(true, predicted, mask(0, 1, 3, 4)) == pytest.approx(1 / 3)
    assert silhouette_iou([], predicted, mask(1, 2, 3, 4)) is None
    assert silhouette_iou(true, [], mask(3, 4)) == 0


def test_masks_of_another_size_are_refused() -> None:
    with pytest.raises(InputError, match=r"\[\(4, 8\), \(4, 9\)\] px"):
        silhouette_iou([mask(0)], [np.ones((4, 9), dtype=bool)])


def test_a_missed_image_counts_in_the_mean():
    box, pose = np.array([[0.0, 0.0, 2.0, 4.0]]), np.zeros((1, 5))
    known = Annotations(box, None)
    found, unsure = (Detections(box, np.array([score]), pose) for score in (0.3, 0.1))
    overlaps = [silhouette_iou([mask(0, 1)], masks) for masks in ([mask(1, 2)], [])]
    score = silhouette_score([found, unsure], [known, known], overlaps, confidence=0.2)
    assert score == SilhouetteScore(
        detected_rate=0.5,
        iou=pytest.approx((1 / 3 + 0) / 2),
        images=2,
        instruments=2,
        iou_low=0,
        iou_high=pytest.approx(1 / 3),  # a quarter of the resamples is each image twice
    )
