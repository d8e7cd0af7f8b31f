"""Masks of shafts."""

import numpy as np
import pytest

from shaftpose.core.masks import RunLengths, crossed_share, is_crossed, mask_box


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


def test_run_lengths_by_hand() -> None:
    # Column by column: (0, 1), (1, 1), (0, 0) are 0 1 1 1 0 0: one zero, three ones, two zeros.
    mask = np.array([[0, 1, 0], [1, 1, 0]], dtype=bool)
    assert RunLengths.of(mask) == RunLengths([1, 3, 2], (2, 3))
    # Counts start with the zeros: 0 if the first pixel is set.
    assert RunLengths.of(~mask) == RunLengths([0, 1, 3, 2], (2, 3))
    assert RunLengths.of(np.zeros((2, 3), dtype=bool)).counts == [6]
    assert RunLengths.of(np.ones((2, 3), dtype=bool)).counts == [0, 6]


@pytest.mark.parametrize("share", [0.0, 0.02, 0.5, 1.0])
def test_run_lengths_round_trip_and_mean_what_coco_says(share: float) -> None:
    rng = np.random.default_rng(3)
    for height, width in [(1, 1), (1, 9), (7, 1), (13, 17)]:
        mask = rng.random((height, width)) < share
        encoded = RunLengths.of(mask)
        np.testing.assert_array_equal(encoded.mask(), mask)
        # COCO: runs of zeros and ones in turn; pixel n is row n mod height of column n / height.
        picture = np.zeros((height, width), dtype=bool)
        n = 0
        for turn, run in enumerate(encoded.counts):
            for _ in range(run):
                picture[n % height, n // height] = turn % 2 == 1
                n += 1
        assert n == height * width
        np.testing.assert_array_equal(picture, mask)
