from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from shaftpose.core.geometry import Camera, Disc
from shaftpose.refinement.straight_runs import Run, straight_runs
from tests.refinement.drawn_shafts import WIDE, Point, drawn

LEFT = (250.0, 170.0), (0.0, 80.0), (24.0, 36.0)
RIGHT = (300.0, 130.0), (531.0, 240.0), (20.0, 40.0)


def the_run(mask: NDArray[np.float32], camera: Camera = WIDE) -> Run:
    (run,) = straight_runs(mask, camera)
    return run


def lies_on(run: Run, tip: Point, tail: Point, px: float = 4.0) -> bool:
    """Whether a run begins at a tip, and its axis is that of a shaft."""
    u = (np.array(tail) - tip) / np.hypot(*np.array(tail) - tip)
    aside = (run.ends - tip) @ [-u[1], u[0]]
    return bool(np.abs(aside).max() < px and np.linalg.norm(run.ends[0] - tip) < 2.5 * px)


def test_a_shaft_has_its_ends_and_widths() -> None:
    run = the_run(drawn(*LEFT))
    assert lies_on(run, *LEFT[:2], px=2)
    assert np.linalg.norm(run.ends[1] - LEFT[1]) < 20  # cut obliquely by the border
    assert run.widths == pytest.approx(LEFT[2], abs=2)
    assert not run.outside


@pytest.mark.parametrize(
    ("tip", "tail", "widths", "px"),
    [
        pytest.param((200.0, 200.0), (260.0, 0.0), (22.0, 30.0), 4, id="crossing"),
        pytest.param((230.0, 225.0), (0.0, 115.0), (24.0, 36.0), 8, id="touching at the border"),
        pytest.param((410.0, 233.0), (531.0, 280.0), (24.0, 30.0), 4, id="pointing at each other"),
    ],
)
def test_shafts_that_meet_are_two(tip: Point, tail: Point, widths: Point, px: float) -> None:
    runs = straight_runs(np.maximum(drawn(*LEFT), drawn(tip, tail, widths)), WIDE)
    assert len(runs) == 2
    assert sum(lies_on(run, *LEFT[:2], px=px) for run in runs) == 1
    assert sum(lies_on(run, tip, tail, px=px) for run in runs) == 1


def test_a_shaft_that_something_hides_in_part_is_one() -> None:
    mask = drawn(*RIGHT)
    mask[:, 360:410] = 0
    assert lies_on(the_run(mask), *RIGHT[:2])


def test_a_highlight_along_a_shaft_makes_no_second_one() -> None:
    mask = drawn(*RIGHT)
    mask[drawn((330.0, 145.0), (480.0, 216.0), (3.0, 3.0)) > 0] = 0
    assert lies_on(the_run(mask), *RIGHT[:2])


def test_a_shaft_from_border_to_border_is_found_once_and_its_tip_is_outside() -> None:
    run = the_run(drawn((0.0, 60.0), (531.0, 160.0), (20.0, 50.0)))
    assert run.outside
    assert run.ends[0, 0] < 10  # the narrow end
    assert run.ends[1, 0] > 520


def test_the_tail_is_at_the_border_along_the_shaft() -> None:
    """The tip lies as near to the upper border as the tail to the left one."""
    run = the_run(drawn((300.0, 25.0), (0.0, 25.0), (30.0, 30.0)))
    assert not run.outside
    assert run.ends[0, 0] > 290


def test_the_border_of_a_round_field_counts() -> None:
    disc = replace(WIDE, field=Disc(265.5, 149.5, 280.0))
    mask = drawn(*LEFT)
    mask[
        np.hypot(*(np.mgrid[:299, :531] + 0.5 - np.array([149.5, 265.5])[:, None, None])) > 140
    ] = 0
    run = the_run(mask, disc)
    assert lies_on(run, *LEFT[:2])
    assert run.ends[1] == pytest.approx([127.0, 126.0], abs=8)
    across = the_run(np.ones_like(mask) * (np.abs(np.arange(299) - 150) < 15)[:, None], disc)
    assert across.outside


def test_a_shaft_of_which_less_than_its_width_is_seen_is_found_at_the_border() -> None:
    run = the_run(drawn((50.0, 150.0), (0.0, 150.0), (70.0, 70.0)))
    assert lies_on(run, (50.0, 150.0), (0.0, 150.0))


def test_small_round_and_thin_regions_are_no_runs() -> None:
    mask = np.zeros((299, 531), np.float32)
    mask[20:35, 20:35] = 1  # too small
    mask[100:140, 100:140] = 1  # a square has no ridge
    mask[200:202, 20:280] = 1
    assert straight_runs(mask, WIDE) == []
    assert straight_runs(0 * mask, WIDE) == []
    assert straight_runs(0 * mask + 1, WIDE) == []
