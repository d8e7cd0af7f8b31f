"""Scores of fitted shafts from a mask."""

import cv2
import numpy as np
import pytest

from shaftpose.refinement.support import distinct, supported
from tests.core.silhouettes import CAMERA, POSES, SHAFT, soft_mask

TRUE = POSES[0]
AXIS = np.array([0.72, 0.604, -0.342])  # sin 70 cos 40, sin 70 sin 40, -cos 70 deg


def moved(along_mm: float) -> np.ndarray:
    """The true pose with its tip further along the axis, towards the handle."""
    return TRUE + np.append(along_mm * AXIS, [0, 0])


def test_the_true_pose_has_full_support() -> None:
    mask = soft_mask(TRUE)
    assert supported(0.8, TRUE, mask, SHAFT, CAMERA) == pytest.approx(0.8**0.125, abs=0.02)


def test_a_shaft_along_the_border_has_full_support() -> None:
    """One of its lines and its tip are not in the image."""
    pose = np.array([21.0, -30.0, 20.0, 88.0, 88.0])
    found = supported(0.8, pose, soft_mask(pose), SHAFT, CAMERA)
    assert found == pytest.approx(0.8**0.125, abs=0.02)


def test_a_tip_in_the_middle_of_a_shaft_has_little() -> None:
    mask = soft_mask(TRUE)
    true, behind, ahead = (
        supported(0.8, moved(along), mask, SHAFT, CAMERA) for along in (0.0, 6.0, -6.0)
    )
    assert behind < 0.95 * true
    assert ahead < 0.8 * true


def test_in_a_mask_of_half_the_certainty_contrasts_and_mean_are_half() -> None:
    half = (0.5 * soft_mask(TRUE)).astype(np.float32)
    expected = (0.8 * 0.5**2 * 0.5 * 0.5**4) ** (1 / 8)
    assert supported(0.8, TRUE, half, SHAFT, CAMERA) == pytest.approx(expected, abs=0.02)


def test_a_shaft_with_a_hole_in_its_mask_has_less() -> None:
    mask = soft_mask(TRUE)
    whole = supported(0.8, TRUE, mask, SHAFT, CAMERA)
    # More than 4 px from the outline, where its contrast is read.
    middle = cv2.erode((mask > 0.9).astype(np.uint8), np.ones((11, 11), np.uint8)) > 0
    share = 1 - middle.sum() / (mask > 0.999).sum()  # of the pixels that it covers whole
    assert 0.5 < share < 0.6
    with_hole = supported(0.8, TRUE, np.where(middle, np.float32(0), mask), SHAFT, CAMERA)
    assert with_hole / whole == pytest.approx(share**0.5, abs=0.01)


def test_without_an_outline_in_the_image_the_score_stays() -> None:
    outside = TRUE + [200.0, 0.0, 0.0, 0.0, -40.0]
    assert supported(0.8, outside, soft_mask(TRUE), SHAFT, CAMERA) == 0.8
    nothing = np.array([0.0, 0.0, 20.0, np.nan, 0.0])
    assert supported(0.8, nothing, soft_mask(TRUE), SHAFT, CAMERA) == 0.0


def test_of_tips_on_one_axis_the_best_is_kept() -> None:
    poses = np.array([TRUE, moved(4.0), moved(-1.0), moved(-12.0)])
    assert distinct(poses, SHAFT, CAMERA) == [0, 3]  # 12 mm in front: another shaft


@pytest.mark.parametrize(("turned_deg", "kept"), [(10.0, [0]), (25.0, [0, 1])])
def test_a_tip_on_another_shaft_counts_if_its_axis_differs(
    turned_deg: float, kept: list[int]
) -> None:
    turned = moved(5.0) + [0, 0, 0, 0, turned_deg]
    assert distinct(np.array([TRUE, turned]), SHAFT, CAMERA) == kept


def test_shafts_that_cross_or_lie_side_by_side_are_kept() -> None:
    crossing = moved(5.0) + [0, 0, 0, 0, 60.0]
    beside = TRUE + [-2.5, 3.5, 0, 0, 0]  # across the axis
    assert distinct(np.array([TRUE, crossing, beside]), SHAFT, CAMERA) == [0, 1, 2]
    assert distinct(np.zeros((0, 5)), SHAFT, CAMERA) == []
