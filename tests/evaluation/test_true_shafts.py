"""Annotated frames of a hundred rows, and the groups of their shafts."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from shaftpose.dataset.coco_images import CocoImage, CocoInstrument, CocoTool, Point
from shaftpose.dataset.compressed_masks import CompressedMask
from shaftpose.evaluation.true_shafts import GROUPS, hidden_share, true_shafts
from shaftpose.metrics.frames.comparison import TrueShafts

HEIGHT, WIDTH = 100, 200


def rows(first: int, last: int, *gaps: int) -> np.ndarray:
    """A mask of whole rows, `last` exclusive, without the columns in `gaps`."""
    mask = np.zeros((HEIGHT, WIDTH), dtype=bool)
    mask[first:last] = True
    mask[:, list(gaps)] = False
    return mask


def shaft(mask: np.ndarray, occluded: bool = False) -> CocoInstrument:
    at = np.flatnonzero(mask.any(axis=1))
    middle = (at[0] + at[-1] + 1) / 2
    axis: tuple[Point, Point] = ((0.0, middle), (float(WIDTH), middle))
    box = (0.0, float(at[0]), float(WIDTH), at[-1] + 1.0)
    return CocoInstrument(box, CompressedMask.of(mask), occluded, axis)


def tool(mask: np.ndarray, shaft_known: bool) -> CocoTool:
    return CocoTool(CompressedMask.of(mask), shaft_known)


def frame(*shafts: CocoInstrument, **more: Any) -> TrueShafts:
    return true_shafts(CocoImage(Path("frame.jpg"), WIDTH, HEIGHT, shafts, **more))


def members(true: TrueShafts) -> dict[str, list[bool]]:
    return {name: true.groups[name].tolist() for name in GROUPS}


def test_the_hidden_share_is_that_of_the_axis() -> None:
    axis = np.array([[0.0, 15.0], [200.0, 15.0]])
    assert hidden_share(rows(10, 20), axis) == 0
    # 50 of 200 columns are covered by something else.
    assert hidden_share(rows(10, 20, *range(100, 150)), axis) == pytest.approx(0.25, abs=0.01)
    assert np.isnan(hidden_share(rows(10, 20), np.full((2, 2), np.nan)))


def test_shafts_far_apart_are_clear() -> None:
    true = frame(shaft(rows(10, 20)), shaft(rows(50, 60)))
    assert true.boxes.tolist() == [[0, 10, 200, 20], [0, 50, 200, 60]]
    assert true.axes.tolist() == [[[0, 15], [200, 15]], [[0, 55], [200, 55]]]
    assert members(true) == {
        "clear": [True, True],
        "crossed": [False, False],
        "occluded": [False, False],
        "hidden": [False, False],
    }
    assert true.tools is None
    assert not true.ignored.any()


def test_outlines_that_meet_are_crossed() -> None:
    # Within one row: 3 of 299 of 100 rows.
    true = frame(shaft(rows(10, 20)), shaft(rows(20, 30)), shaft(rows(32, 40)))
    assert members(true)["crossed"] == [True, True, False]
    assert members(true)["clear"] == [False, False, True]


def test_a_tool_crosses_others_and_not_its_own_shaft() -> None:
    own, other = tool(rows(10, 24), shaft_known=True), tool(rows(45, 50), shaft_known=False)
    true = frame(shaft(rows(10, 20)), shaft(rows(50, 60)), tools=(own, other))
    assert members(true)["crossed"] == [False, True]
    assert true.tools is not None
    assert np.array_equal(true.tools, rows(10, 24) | rows(45, 50))
    assert np.array_equal(true.ignored, rows(45, 50))


def test_a_known_shaft_is_never_ignored() -> None:
    true = frame(shaft(rows(10, 20)), tools=(tool(rows(15, 30), shaft_known=False),))
    assert np.array_equal(true.ignored, rows(20, 30))


def test_crowds_are_ignored() -> None:
    crowd = CocoInstrument((0.0, 70.0, 200.0, 90.0), None, False)
    assert np.array_equal(frame(crowds=(crowd,)).ignored, rows(70, 90))


def test_occluded_is_what_is_stated_or_hidden() -> None:
    little, much = rows(50, 60, *range(100, 115)), rows(80, 90, *range(100, 160))
    true = frame(shaft(rows(10, 20), occluded=True), shaft(little), shaft(much))
    np.testing.assert_allclose(true.hidden_shares, [0, 0.075, 0.3], atol=0.01)
    assert members(true)["occluded"] == [True, True, True]
    assert members(true)["hidden"] == [False, False, True]
    assert members(true)["clear"] == [False, False, False]


def test_a_frame_without_instruments_has_no_shafts() -> None:
    true = frame()
    assert (true.boxes.shape, true.axes.shape) == ((0, 4), (0, 2, 2))
    assert all(group.shape == (0,) and group.dtype == bool for group in true.groups.values())
