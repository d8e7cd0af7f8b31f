"""Frames of ten rows, compared by hand."""

import numpy as np
import pytest

from shaftpose.metrics.frames.comparison import ComparedFrame, compare_frame
from tests.metrics.frames.hand_made import NOTHING, band, found_shafts, true_shafts


def hits(frame: ComparedFrame) -> dict[str, list[int]]:
    return {criterion: hit.tolist() for criterion, hit in frame.hits.items()}


def test_a_detection_hits_by_each_criterion_alone() -> None:
    # Rows 0-3; found are rows 1-4, which share 3 of 5. At the limit of 1 row (axes: 10/299 of 10
    # rows is a third of a row), the axis is 1 row away.
    frame = compare_frame(true_shafts(band(0, 3)), found_shafts((0.9, band(1, 4))), 0.5)
    assert hits(frame) == {"box": [0], "mask": [0], "axis": [-1], "segment": [0]}
    np.testing.assert_allclose(frame.segment_iou, [3 / 5])
    assert frame.image_iou == pytest.approx(3 / 5)


def test_half_the_union_is_enough_for_a_mask_and_not_for_a_segment() -> None:
    frame = compare_frame(true_shafts(band(0, 2)), found_shafts((0.9, band(1, 3))), 0.5)
    assert hits(frame) == {"box": [0], "mask": [0], "axis": [-1], "segment": [-1]}
    assert frame.segment_iou.tolist() == [0]


def test_a_second_detection_of_a_shaft_hits_nothing() -> None:
    twice = found_shafts((0.9, band(0, 3)), (0.8, band(0, 3)))
    frame = compare_frame(true_shafts(band(0, 3)), twice, 0.5)
    assert hits(frame) == dict.fromkeys(("box", "mask", "axis", "segment"), [0, -1])


def test_a_pixel_belongs_to_the_best_score_and_unsure_shafts_have_none() -> None:
    # Rows 0-3 and 4-7. The first covers 0-4, so that of the second, 4-7, 3 of 4 rows remain.
    found = found_shafts((0.9, band(0, 4)), (0.6, band(4, 7)), (0.4, band(8, 9)))
    frame = compare_frame(true_shafts(band(0, 3), band(4, 7)), found, 0.5)
    np.testing.assert_allclose(frame.segment_iou, [4 / 5, 3 / 4, 0])
    assert frame.image_iou == pytest.approx(8 / 8)
    assert compare_frame(true_shafts(band(8, 9)), found, 0.5).image_iou == 0
    assert compare_frame(true_shafts(band(8, 9)), found, 0.4).hits["segment"].tolist() == [
        -1, -1, 0,
    ]  # fmt: skip


def test_detections_mostly_on_an_unknown_instrument_are_neutral() -> None:
    true = true_shafts(band(0, 1), ignored=band(4, 7))
    # Rows 3-5 lie on it by two of three, rows 2-5 by half.
    frame = compare_frame(true, found_shafts((0.9, band(3, 5)), (0.8, band(2, 5))), 0.5)
    assert frame.neutral.tolist() == [True, False]
    # Its pixels are part of no segment: of rows 0-4 remain 0-3, of which the shaft fills 2, half.
    frame = compare_frame(true, found_shafts((0.9, band(0, 4))), 0.5)
    assert hits(frame)["segment"] == [-1]
    frame = compare_frame(true_shafts(band(0, 2), ignored=band(4, 7)),
                          found_shafts((0.9, band(0, 4))), 0.5)  # fmt: skip
    np.testing.assert_allclose(frame.segment_iou, [3 / 4])
    assert frame.image_iou == pytest.approx(3 / 4)


def test_shafts_of_unknown_axes_are_not_asked_for_but_may_be_hit() -> None:
    axes = np.full((1, 2, 2), np.nan)
    found = found_shafts((0.9, band(0, 3)), (0.8, band(6, 9)))
    frame = compare_frame(true_shafts(band(0, 3), axes=axes), found, 0.5)
    assert frame.counted["axis"].tolist() == [False]
    assert frame.counted["box"].tolist() == [True]
    assert frame.hits["axis"].tolist() == [0, -1]


def test_tools_are_compared_as_one_mask() -> None:
    true, found = true_shafts(tools=band(0, 3)), found_shafts(tools=band(1, 4))
    assert compare_frame(true, found, 0.5).tool_iou == pytest.approx(3 / 5)
    assert compare_frame(true, found_shafts(tools=NOTHING), 0.5).tool_iou == 0
    assert compare_frame(true, found_shafts(), 0.5).tool_iou is None
    assert compare_frame(true_shafts(), found, 0.5).tool_iou is None


def test_a_frame_is_empty_without_any_part_of_an_instrument() -> None:
    nothing = found_shafts()
    assert compare_frame(true_shafts(), nothing, 0.5).empty
    assert compare_frame(true_shafts(tools=NOTHING), nothing, 0.5).empty
    for shown in (
        true_shafts(band(0, 1)),
        true_shafts(tools=band(0, 1)),
        true_shafts(ignored=band(0, 1)),
    ):
        assert not compare_frame(shown, nothing, 0.5).empty
    assert compare_frame(true_shafts(), nothing, 0.5).image_iou is None
