import numpy as np
from numpy.typing import NDArray

from shaftpose.refinement.ridges import Lines, ridge_lines
from tests.refinement.drawn_shafts import drawn

FIELD = np.ones((299, 531), dtype=bool)


def lines_of(mask: NDArray[np.float32], field: NDArray[np.bool_] = FIELD) -> Lines:
    return ridge_lines(mask > 0.5, field, np.random.default_rng(0))


def test_half_widths_of_a_shaft_change_linearly_along_its_axis() -> None:
    lines = lines_of(drawn((100, 150), (400, 150), (20, 50)))
    assert len(lines.halves) == 24
    assert np.abs(np.abs(lines.directions) - [1, 0]).max() < 0.05
    towards_tail = np.sign(lines.directions[:, 0])
    assert np.abs(np.median(lines.slopes * towards_tail) - 15 / 300) < 0.005
    at_tip = (lines.halves_at((100 - lines.points[:, :1]) * towards_tail[:, None])).ravel()
    assert np.abs(np.median(at_tip) - 10) < 1


def test_where_the_field_ends_a_shaft_may_continue() -> None:
    mask = drawn((100, 150), (400, 150), (30, 30))
    field = FIELD.copy()
    field[:, 300:] = False
    mask[:, 300:] = 0
    ends = lines_of(mask, field).points[:, 0].max(), lines_of(mask).points[:, 0].max()
    assert ends[0] > 286 > ends[1]  # within 15 px of its own end, the mask has no ridge


def test_lines_through_a_crossing_keep_their_direction() -> None:
    both = np.maximum(
        drawn((100, 50), (400, 250), (24, 24)), drawn((400, 50), (100, 250), (24, 24))
    )
    slopes = np.divide(*lines_of(both).directions.T[::-1])
    assert np.abs(np.abs(slopes) - 2 / 3).max() < 0.05


def test_nothing_and_thin_things_have_no_lines() -> None:
    assert len(lines_of(np.zeros((299, 531), np.float32)).halves) == 0
    assert len(lines_of(drawn((100, 150), (400, 150), (2, 2))).halves) == 0
