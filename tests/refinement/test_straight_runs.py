"""Straight runs of drawn masks."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from shaftpose.core.geometry import Array, Camera, Disc
from shaftpose.refinement.straight_runs import Run, straight_runs

CAMERA = Camera(400, 300, 200.0, 200.0, 150.0)
Bar = tuple[tuple[float, float], tuple[float, float], float, float]
LEFT: Bar = ((200, 150), (-40, 150), 20, 32)  # tip, end beyond the border, widths there
DOWN: Bar = ((120, 60), (170, 340), 24, 40)


def drawn(*bars: Bar) -> NDArray[np.float32]:
    mask = np.zeros((300, 400), np.float32)
    for tip, end, narrow, wide in bars:
        first, last = np.array(tip, float), np.array(end, float)
        along = (last - first) / np.linalg.norm(last - first)
        across = np.array([-along[1], along[0]])
        corners = [
            first + narrow / 2 * across, last + wide / 2 * across,
            last - wide / 2 * across, first - narrow / 2 * across,
        ]  # fmt: skip
        cv2.fillConvexPoly(mask, np.array(corners).round().astype(np.int32), (1.0,))
    return mask


def near(run: Run, tip: tuple[float, float], px: float = 6.0) -> bool:
    return bool(np.linalg.norm(run.ends[0] - tip) < px)


def angle_deg(run: Run, bar: Bar) -> float:
    true: Array = np.subtract(bar[1], bar[0])
    cosine = run.direction @ true / np.linalg.norm(true)
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def test_a_bar_is_one_run_from_its_tip_to_the_border() -> None:
    (run,) = straight_runs(drawn(LEFT), CAMERA)
    assert near(run, LEFT[0]) and run.ends[1, 0] < 10 and not run.outside
    assert angle_deg(run, LEFT) < 2
    assert run.widths == pytest.approx([20, 30], abs=4)


def test_crossing_bars_are_two_runs() -> None:
    runs = straight_runs(drawn(LEFT, DOWN), CAMERA)
    assert len(runs) == 2
    for bar in (LEFT, DOWN):
        (run,) = [each for each in runs if near(each, bar[0])]
        assert angle_deg(run, bar) < 3


def test_a_bar_that_something_interrupts_is_one_run() -> None:
    mask = drawn(LEFT)
    mask[:, 90:120] = 0
    (run,) = straight_runs(mask, CAMERA)
    assert near(run, LEFT[0]) and run.ends[1, 0] < 10


def test_a_bar_through_the_whole_image_has_its_tip_outside() -> None:
    (run,) = straight_runs(drawn(((440, 100), (-40, 200), 20, 40)), CAMERA)
    assert run.outside and run.ends[0, 0] > 390  # the narrower end


def test_a_round_field_ends_a_bar() -> None:
    field = Disc(200.0, 150.0, 260.0)
    camera = Camera(400, 300, 200.0, 200.0, 150.0, field=field)
    mask = drawn(LEFT)
    y, x = np.mgrid[:300, :400] + 0.5
    mask[np.hypot(x - 200, y - 150) > 130] = 0
    (run,) = straight_runs(mask, camera)
    assert near(run, LEFT[0]) and run.ends[1, 0] < 80 and not run.outside


def test_small_round_and_thin_regions_are_no_shafts() -> None:
    mask = np.zeros((300, 400), np.float32)
    mask[20:32, 20:32] = 1  # too small
    mask[100:140, 100:140] = 1  # as wide as long
    mask[200:202, 20:280] = 1  # too thin
    assert straight_runs(mask, CAMERA) == []
    assert straight_runs(0 * mask, CAMERA) == []
