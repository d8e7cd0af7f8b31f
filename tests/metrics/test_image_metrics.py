"""Silhouettes small enough to count by hand, and axes whose errors are known by hand."""

from dataclasses import replace

import numpy as np
import pytest

from shaftpose.core.errors import InputError
from shaftpose.core.geometry import Camera, Disc, projected_axes
from shaftpose.core.instruments import Annotations, Detections
from shaftpose.metrics.image_metrics import (
    ImageErrors,
    SilhouetteScore,
    image_errors,
    silhouette_iou,
    silhouette_score,
)

NOTHING = ImageErrors(np.empty(0), np.empty(0), np.empty(0))


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
    score = silhouette_score([found, unsure], [known, known], overlaps, NOTHING, confidence=0.2)
    assert score == SilhouetteScore(
        detected_rate=0.5,
        iou=pytest.approx((1 / 3 + 0) / 2),
        images=2,
        instruments=2,
        iou_low=0,
        iou_high=pytest.approx(1 / 3),  # a quarter of the resamples is each image twice
    )


CAMERA = Camera(width=100, height=100, focal_px=50.0, cx=50.0, cy=50.0)
BOXES = np.array([[0.0, 0.0, 40.0, 40.0], [50.0, 50.0, 100.0, 90.0]])
# Across the view, 10 mm away: 5 px to the mm. Tips at (40, 50) and (60, 60) px.
POSES = np.array([[-2.0, 0.0, 10.0, 90.0, 0.0], [2.0, 2.0, 10.0, 90.0, 90.0]])


def found(scores: list[float]) -> Detections:
    return Detections(BOXES, np.array(scores), POSES)


def test_axes_are_projected_from_the_tip_towards_the_handle() -> None:
    expected = [[[40, 50], [45, 50]], [[60, 60], [60, 65]]]
    np.testing.assert_allclose(projected_axes(POSES, CAMERA), expected)


def test_errors_are_distances_of_tips_and_angles_of_axes() -> None:
    # 3 and 4 px off; a true axis 45 deg to the left of the first, the second reversed.
    true = np.array([[[43.0, 54.0], [53.0, 44.0]], [[60.0, 60.0], [60.0, 20.0]]])
    errors = image_errors([found([0.9, 0.8])], [Annotations(BOXES, None)], [true], [CAMERA])
    np.testing.assert_allclose(errors.tip_px, [5, 0], atol=1e-9)
    np.testing.assert_allclose(errors.axis_deg, [45, 180])
    # The first leaves the image at (97, 0), 50 px above the estimated line, the second at (60, 0).
    np.testing.assert_allclose(errors.axis_px, [50, 0], atol=1e-9)


def test_axes_leave_the_image_at_its_next_border_on_their_way() -> None:
    # The estimated axes are the lines y = 50, to the right, and x = 60, downwards. The true ones
    # leave at (100, 42), and at a tip that is outside.
    true = np.array([[[40.0, 54.0], [45.0, 53.0]], [[70.0, 130.0], [70.0, 140.0]]])
    errors = image_errors([found([0.9, 0.8])], [Annotations(BOXES, None)], [true], [CAMERA])
    np.testing.assert_allclose(errors.axis_px, [8, 10])


def test_axes_leave_a_round_field_at_its_rim() -> None:
    # The first, from (40, 50) along (0.6, 0.8), leaves the circle of 30 px around (50, 50) after
    # s px: (0.6 s - 10)^2 + (0.8 s)^2 = 900. The estimated line is y = 50.
    camera = replace(CAMERA, field=Disc(50, 50, 60))
    true = np.array([[[40.0, 50.0], [43.0, 54.0]], [[60.0, 60.0], [60.0, 67.0]]])
    errors = image_errors([found([0.9, 0.8])], [Annotations(BOXES, None)], [true], [camera])
    np.testing.assert_allclose(errors.axis_px, [0.8 * (6 + 836**0.5), 0], atol=1e-9)


@pytest.mark.parametrize(("scores", "expected"), [([0.9, 0.4], 1), ([0.4, 0.4], 0)])
def test_only_found_instruments_with_a_known_axis_count(scores: list[float], expected: int) -> None:
    true = np.array([[[40.0, 50.0], [50.0, 50.0]], [[60.0, 60.0], [60.0, 70.0]]])
    known = Annotations(BOXES, None)
    errors = image_errors([found(scores)], [known], [true], [CAMERA])
    assert len(errors.tip_px) == len(errors.axis_deg) == len(errors.axis_px) == expected
    true[0] = np.nan
    assert not len(image_errors([found([0.9, 0.4])], [known], [true], [CAMERA]).tip_px)
    assert not len(image_errors([], [], [], []).tip_px)
