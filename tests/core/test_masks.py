"""Masks of shafts."""

import numpy as np
import pytest

from shaftpose.core.masks import crossed_share, is_crossed, mask_box


def test_mask_box_by_hand() -> None:
    mask = np.zeros((10, 20), dtype=bool)
    mask[3, 4] = True
    assert mask_box(mask) == (4, 3, 5, 4)
    mask[7, 19] = True
    assert mask_box(mask) == (4, 3, 20, 8)
    assert mask_box(np.ones((2, 3), dtype=bool)) == (0, 0, 3, 2)


def test_empty_mask_has_no_box() -> None:
    with pytest.raises(ValueError, match="empty"):
        mask_box(np.zeros((4, 4), dtype=bool))


def test_the_most_covered_mask_counts() -> None:
    """The front mask covers 1, 1 and 0 pixels of masks of 4, 2 and 0 pixels."""
    rows = np.array([[1, 1, 1, 1, 0, 0, 0], [0, 0, 0, 0, 1, 1, 0], [0, 0, 0, 0, 0, 0, 0]], bool)
    front = np.array([0, 0, 0, 1, 1, 0, 1], dtype=bool)
    assert crossed_share(front, rows[:1]) == 0.25
    assert crossed_share(front, rows) == 0.5
    assert crossed_share(front, rows[2:]) == 0
    assert crossed_share(front, []) == 0


def test_a_shaft_is_crossed_if_the_share_is_wanted_and_not_nothing() -> None:
    assert [is_crossed(share, (0.0, 0.5)) for share in (0.0, 0.1, 0.5, 0.6)] == [
        False, True, True, False,
    ]  # fmt: skip
    assert not is_crossed(0.1, (0.2, 0.5))
