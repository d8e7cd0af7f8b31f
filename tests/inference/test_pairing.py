"""One-to-one pairing of two sets."""

import numpy as np
import pytest

from shaftpose.inference.pairing import nearest_pairs


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
