from dataclasses import replace

import numpy as np
import pytest

from shaftpose.core.geometry import Disc
from shaftpose.refinement.ridges import Lines
from shaftpose.refinement.slices import slice_contrasts, visible
from tests.refinement.drawn_shafts import WIDE, drawn

MASK = drawn((100, 150), (400, 150), (40, 40))
LINE = Lines(np.array([[100.0, 150.0]]), np.array([[1.0, 0.0]]), np.array([20.0]), np.zeros(1))
KNOWN = np.ones(MASK.shape, dtype=bool)


def test_visible_pixels_are_those_in_the_disc() -> None:
    assert visible(MASK, WIDE).all()
    shown = visible(MASK, replace(WIDE, field=Disc(200.0, 150.0, 100.0)))
    assert shown.sum() == pytest.approx(np.pi * 50**2, rel=0.01)
    assert shown[150, 151]
    assert not shown[150, 149]


def test_contrasts_along_beside_and_beyond_a_shaft() -> None:
    aside = LINE._replace(points=LINE.points + [0.0, 100.0])
    both = Lines(*(np.concatenate(pair) for pair in zip(LINE, aside, strict=True)))
    contrasts, weights = slice_contrasts(MASK, KNOWN, both, np.array([[50.0, 350.0]] * 2))
    np.testing.assert_array_equal(contrasts, [[1, 0], [0, 0]])
    np.testing.assert_array_equal(weights, 1)


def test_a_line_as_wide_as_half_the_shaft_has_mask_beside_it() -> None:
    narrow = LINE._replace(halves=np.array([10.0]))
    contrasts, _ = slice_contrasts(MASK, KNOWN, narrow, np.array([[50.0]]))
    assert contrasts[0, 0] == 0
    # Its axis is 10 px off: of its two sides, one is in the mask.
    off = narrow._replace(points=narrow.points + [0.0, 10.0])
    assert slice_contrasts(MASK, KNOWN, off, np.array([[50.0]]))[0][0, 0] == 0.5


def test_what_is_unknown_has_no_say() -> None:
    known = KNOWN.copy()
    known[:150] = False  # 2 of 5 places inside, and one of the two beside
    contrasts, weights = slice_contrasts(MASK, known, LINE, np.array([[50.0, 500.0]]))
    np.testing.assert_allclose(contrasts, [[1, 0]])
    np.testing.assert_allclose(weights, [[0.6, 0]])  # at 600 px there is no image
    known[175:] = False
    assert slice_contrasts(MASK, known, LINE, np.array([[50.0]]))[1][0, 0] == 0
