"""The rendered rectangles, by hand and by their guarantees."""

import numpy as np
import pytest
from numpy.typing import NDArray

from shaftpose.rendering.regions import Region, cover

FREE = 0.0


def empty() -> NDArray[np.bool_]:
    return np.zeros((40, 60), dtype=bool)


def diagonal() -> NDArray[np.bool_]:
    rows, columns = np.indices((40, 60))
    return np.abs(2 * columns - 3 * rows) <= 6


def area(regions: list[Region]) -> int:
    return sum((r.x1 - r.x0) * (r.y1 - r.y0) for r in regions)


def test_nothing_needs_no_rectangle() -> None:
    assert cover(empty(), FREE) == []


def test_a_rectangle_is_its_own() -> None:
    mask = empty()
    mask[5:12, 20:50] = True
    assert cover(mask, FREE) == [Region(20, 5, 50, 12)]
    mask[:] = False
    mask[7, 9] = True
    assert cover(mask, FREE) == [Region(9, 7, 10, 8)]


@pytest.mark.parametrize("turned", [False, True])
def test_two_rectangles_are_parted_if_that_saves_more_than_a_render_costs(turned: bool) -> None:
    mask = empty()
    mask[0:4, 0:10] = mask[20:24, 30:40] = True
    whole, parts = Region(0, 0, 40, 24), [Region(0, 0, 10, 4), Region(30, 20, 40, 24)]
    if turned:
        mask = mask.T
        whole, *parts = (Region(r.y0, r.x0, r.y1, r.x1) for r in (whole, *parts))
    # 40 x 24 = 960 px in one; split after the first, 10 x 4 + 30 x 4 = 160 px.
    assert cover(mask, 799) == parts
    assert cover(mask, 800) == [whole]


@pytest.mark.parametrize("render_px", [FREE, 30.0, 200.0])
def test_rectangles_hold_everything_once(render_px: float) -> None:
    counts = np.zeros((40, 60), dtype=int)
    for region in cover(diagonal(), render_px):
        counts[region.slices] += 1
    assert counts.max() == 1
    assert np.all(counts[diagonal()] == 1)


def test_a_diagonal_is_cut_the_finer_the_cheaper_a_render_is() -> None:
    costs = 20.0, 200.0, 3000.0
    found = [cover(diagonal(), cost) for cost in costs]
    assert len(found[0]) > len(found[1]) > len(found[2]) == 1
    assert area(found[0]) < area(found[1]) < area(found[2]) == 40 * 60
    for regions, cost in zip(found, costs, strict=True):
        assert area(regions) + cost * (len(regions) - 1) <= 40 * 60
