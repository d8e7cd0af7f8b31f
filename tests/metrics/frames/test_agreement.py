"""Overlaps of masks and axes, worked by hand."""

import numpy as np
import pytest

from shaftpose.metrics.frames.agreement import axis_agreement, greedy_matches, mask_iou

# 299 px on the shorter side, so axes may be 10 px apart. The true axis runs from the tip at
# (100, 100) to the right.
FRAME = (299, 500)
TRUE = np.array([[[100.0, 100.0], [200.0, 100.0]]])


def agreement(*found: list[list[float]], true: np.ndarray = TRUE) -> list[float]:
    return axis_agreement(np.array(found), true, FRAME)[:, 0].tolist()


def mask(*columns: int) -> np.ndarray:
    filled = np.zeros((4, 8), dtype=bool)
    filled[:, list(columns)] = True
    return filled


def test_the_distance_is_that_of_both_true_ends_from_the_endless_found_axis() -> None:
    same, beside, far = ([[120.0, y], [130.0, y]] for y in (100.0, 110.0, 110.1))
    assert agreement(same, beside, far) == pytest.approx([1, 1 / 2, 0])
    # It passes 2 px above the tip and, rising by 4 in 100 px (2.3 deg), 6 px above the tail.
    rising = [[100.0, 102.0], [200.0, 106.0]]
    assert agreement(rising) == pytest.approx([10 / (10 + 6 * 100 / np.hypot(100, 4))])


def test_angles_over_five_degrees_and_reversed_axes_are_wrong() -> None:
    # Through the middle of a short axis, so that its ends are near: 4.9 and 5.1 deg.
    short = np.array([[[100.0, 100.0], [120.0, 100.0]]])
    turned = [
        [[110.0, 100.0], [110.0 + np.cos(angle), 100.0 + np.sin(angle)]]
        for angle in np.radians([4.9, 5.1, 180.0])
    ]
    near, turned_too_far, reverse = agreement(*turned, true=short)
    assert near > 0.9
    assert (turned_too_far, reverse) == (0, 0)


def test_an_unknown_axis_agrees_with_nothing() -> None:
    assert agreement(TRUE[0].tolist(), true=np.full((1, 2, 2), np.nan)) == [0]
    assert axis_agreement(np.empty((0, 2, 2)), TRUE, FRAME).shape == (0, 1)
    assert axis_agreement(TRUE, np.empty((0, 2, 2)), FRAME).shape == (1, 0)


def test_masks_overlap_by_their_shared_columns() -> None:
    found, true = [mask(0, 1, 2), mask()], [mask(1, 2, 3), mask(7), mask()]
    np.testing.assert_allclose(mask_iou(found, true), [[2 / 4, 0, 0], [0, 0, 0]])


def test_each_detection_takes_the_best_free_shaft() -> None:
    # The first prefers shaft 1, so the second has to take shaft 0, and nothing is left for the
    # third. The fourth agrees with none.
    values = np.array([[0.6, 0.7], [0.5, 0.9], [0.8, 0.0], [0.0, 0.0]])
    assert greedy_matches(values).tolist() == [1, 0, -1, -1]
    assert greedy_matches(np.empty((2, 0))).tolist() == [-1, -1]
