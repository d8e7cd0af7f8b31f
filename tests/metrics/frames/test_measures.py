"""Metrics of a few frames, worked by hand."""

import numpy as np
import pytest

from shaftpose.metrics.frames.comparison import ComparedFrame, compare_frame
from shaftpose.metrics.frames.measures import Counts, Estimate, FrameMetrics, frame_metrics
from tests.metrics.frames.hand_made import band, found_shafts, true_shafts

TOP, MIDDLE, BOTTOM = band(0, 1), band(4, 5), band(8, 9)


def groups(**members: list[bool]) -> dict[str, np.ndarray]:
    return {name: np.array(chosen, dtype=bool) for name, chosen in members.items()}


# One frame shows two shafts; the second is found with half its rows, beside a false one. Another
# shows one, which is missed, and a third none: it gets a false detection that is not sure.
TRUE = [
    true_shafts(
        TOP, band(4, 7), hidden_shares=np.array([0.0, 0.5]),
        groups=groups(clear=[True, False], occluded=[False, True]),
    ),
    true_shafts(
        MIDDLE, hidden_shares=np.array([np.nan]), groups=groups(clear=[True], occluded=[False])
    ),
    true_shafts(groups=groups(clear=[], occluded=[])),
]  # fmt: skip
FOUND = [
    found_shafts((0.9, TOP), (0.8, BOTTOM), (0.7, band(4, 6)), (0.3, MIDDLE)),
    found_shafts(),
    found_shafts((0.4, TOP)),
]


def at(threshold: float) -> list[ComparedFrame]:
    return [compare_frame(*pair, threshold) for pair in zip(TRUE, FOUND, strict=True)]


FRAMES = at(0.5)
OPERATIONS = ["a", "a", "b"]


def values(frames: list[ComparedFrame], group: str | None = None) -> dict[str, float | None]:
    found = frame_metrics(frames, ["a"] * len(frames), group)
    return {name: estimate.value for name, estimate in found.metrics.items()}


def test_all_shafts_by_hand() -> None:
    found = values(FRAMES)
    # In turn right, wrong, right, wrong, wrong: precisions 1, 1/2, 2/3 at recalls 1/3, 1/3, 2/3.
    assert found["box_ap50"] == found["mask_ap50"] == pytest.approx(1 / 3 * 1 + 1 / 3 * 2 / 3)
    assert (found["box_recall"], found["box_precision"]) == pytest.approx((2 / 3, 2 / 3))
    # The second axis, half a row off, is beyond a third of a row.
    assert (found["axis_recall"], found["axis_precision"]) == pytest.approx((1 / 3, 1 / 3))
    assert found["axis_recall_at_precision"] == pytest.approx(1 / 3)
    # Overlaps 1 and 3/4; one false, one missed.
    assert found["pq"] == pytest.approx(1.75 / (2 + 1 / 2 + 1 / 2))
    assert found["shaft_iou"] == pytest.approx(1.75 / 4)
    # Five of eight rows are in both unions, none in the second frame.
    assert found["image_iou"] == pytest.approx((5 / 8 + 0) / 2)
    assert found["empty_detected"] == 0
    assert found["tool_iou"] is None


def test_counts_are_of_segments_above_the_threshold() -> None:
    assert frame_metrics(FRAMES, OPERATIONS).counts == Counts(
        frames=3, operations=2, shafts=3, found=2, missed=1, false=1
    )
    assert frame_metrics(at(0.3), OPERATIONS).counts.false == 3


def test_in_a_group_other_shafts_are_neither_found_nor_false() -> None:
    occluded = frame_metrics(FRAMES, OPERATIONS, "occluded")
    # Of the only frame that shows one: wrong, right, wrong.
    assert occluded.counts == Counts(1, 1, shafts=1, found=1, missed=0, false=1)
    found = values(FRAMES, "occluded")
    assert (found["box_ap50"], found["box_recall"], found["box_precision"]) == (0.5, 1, 0.5)
    assert found["pq"] == pytest.approx(0.75 / 1.5)
    assert found["image_iou"] == pytest.approx(5 / 8)
    clear = values(FRAMES, "clear")
    assert (clear["box_recall"], clear["box_precision"]) == (0.5, 0.5)
    assert clear["image_iou"] == pytest.approx(5 / 16)
    assert "tool_iou" not in clear


def test_the_hidden_share_is_the_mean_of_known_ones() -> None:
    assert frame_metrics(FRAMES, OPERATIONS).hidden_share == 0.25
    assert frame_metrics(FRAMES, OPERATIONS, "occluded").hidden_share == 0.5
    assert frame_metrics(FRAMES[2:], ["b"]).hidden_share is None


def test_neutral_detections_count_nowhere() -> None:
    frame = compare_frame(
        true_shafts(TOP, ignored=MIDDLE), found_shafts((0.9, MIDDLE), (0.8, TOP)), 0.5
    )
    found = values([frame])
    assert (found["box_ap50"], found["box_precision"], found["pq"]) == (1, 1, 1)
    assert found["empty_detected"] is None


def test_what_is_not_there_is_undefined() -> None:
    found = values(FRAMES[2:])
    assert {name for name, value in found.items() if value is not None} == {"empty_detected"}
    unsure = values(at(0.3)[2:])
    assert (unsure["empty_detected"], unsure["pq"]) == (1, 0)
    assert set(frame_metrics([], []).metrics.values()) == {Estimate(None)}


def recall(frames: list[ComparedFrame], operations: list[str]) -> Estimate:
    measured: FrameMetrics = frame_metrics(frames, operations)
    return measured.metrics["box_recall"]


def test_intervals_are_over_operations() -> None:
    seen = compare_frame(true_shafts(TOP), found_shafts((0.9, TOP)), 0.5)
    missed = compare_frame(true_shafts(TOP), found_shafts(), 0.5)
    assert recall([seen, missed], ["a", "a"]) == Estimate(0.5, None, None)
    # Two operations: a quarter of the resamples is one of them twice.
    assert recall([seen, missed], ["a", "b"]) == Estimate(0.5, 0, 1)
    # Each of them has one found and one missed shaft, so that every resample is the same.
    assert recall([seen, missed] * 2, ["a", "a", "b", "b"]) == Estimate(0.5, 0.5, 0.5)
