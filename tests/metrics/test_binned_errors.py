"""Binned errors of instruments with known bins and errors."""

from dataclasses import replace

import numpy as np
import pytest

from shaftpose.core.instruments import Annotations, Detections
from shaftpose.figures.variant_figures import binned_error_figure
from shaftpose.metrics.binned_errors import BINS, binned_errors
from shaftpose.metrics.pose_errors import errors_between, pose_errors
from shaftpose.settings.schema import PoseRanges

# z 12, 12, 12 and 40 mm; yaw 355, 2, 300 and 180 deg; tip errors 1, 2, 6 and 4 mm, all along x.
# The last pose's pitch is 3 deg too small, so its axis error is 3 deg.
TRUE = np.array(
    [[0, 0, 12, 70, 355], [0, 0, 12, 70, 2], [0, 0, 12, 70, 300], [0, 0, 40, 90, 180]], dtype=float
)
WRONG = TRUE + np.outer([1, 2, 6, 4], [1, 0, 0, 0, 0]) - np.outer([0, 0, 0, 3], [0, 0, 0, 1, 0])
ERRORS = errors_between(WRONG, TRUE)
RANGES = PoseRanges(
    x_mm=(-20, 20), y_mm=(-20, 20), z_mm=(10, 40), pitch_deg=(50, 90), yaw_deg=(0, 358)
)
LIMITS = RANGES.low, RANGES.high
FOUND = binned_errors(
    ERRORS,
    np.array([1.0, 0.4, 0.8, 1.0]),
    np.array([5.0, 15.0, 15.0, 149.0]),
    *LIMITS,
)


def bin_of(quantity: str, low: float) -> tuple[int, float | None, float | None]:
    (found,) = (one for one in FOUND[quantity] if one.low == low)
    return found.count, found.tip_mm, found.axis_deg


def test_medians_of_each_bin():
    assert bin_of("z_mm", 10) == (3, 2.0, 0.0)
    turned = (1, 4.0, pytest.approx(3.0))
    assert bin_of("z_mm", 35) == turned  # the upper end belongs to the last bin
    assert bin_of("z_mm", 20) == (0, None, None)
    assert bin_of("pitch_deg", 82) == turned
    assert bin_of("border_px", 10) == (2, 4.0, 0.0)
    assert bin_of("border_px", 80) == turned


def test_the_bias_of_the_depth_keeps_its_sign():
    # Near shafts 1, 3 and 4 mm too far, a far one 2 mm too near.
    wrong = TRUE + np.outer([1, 3, 4, -2], [0, 0, 1, 0, 0])
    bins = binned_errors(errors_between(wrong, TRUE), np.ones(4), np.ones(4), *LIMITS)
    assert [one.z_bias_mm for one in bins["z_mm"]] == [3.0, None, None, None, None, -2.0]


def test_yaw_is_counted_from_the_seam_on_both_sides():
    assert bin_of("yaw_from_seam_deg", -10)[:2] == (1, 1.0)  # 355 deg
    assert bin_of("yaw_from_seam_deg", 0)[:2] == (1, 2.0)  # 2 deg
    assert bin_of("yaw_from_seam_deg", -30)[:2] == (0, None)
    assert bin_of("yaw_from_seam_deg", -60)[:2] == (1, 6.0)  # 300 deg; the lower end counts
    assert bin_of("yaw_from_seam_deg", -180)[:2] == (1, 4.0)


def test_the_seam_is_where_the_range_of_yaw_begins():
    other = replace(RANGES, yaw_deg=(-180, 178))
    bins = binned_errors(ERRORS, np.ones(4), np.ones(4), other.low, other.high)
    beside = {one.low: one.count for one in bins["yaw_from_seam_deg"] if one.low in (-10, 0)}
    assert beside == {-10: 0, 0: 1}  # 180 deg


def test_every_instrument_is_in_one_bin_of_each_quantity():
    assert {name: sum(one.count for one in row) for name, row in FOUND.items()} == dict.fromkeys(
        BINS, 4
    )


def test_the_bins_of_depth_and_pitch_divide_the_ranges_that_poses_come_from():
    far = replace(RANGES, z_mm=(10, 130), pitch_deg=(40, 90))
    bins = binned_errors(ERRORS, np.ones(4), np.ones(4), far.low, far.high)
    assert [one.low for one in bins["z_mm"]] == [10, 30, 50, 70, 90, 110]
    assert [one.count for one in bins["z_mm"]] == [3, 1, 0, 0, 0, 0]
    assert [one.high for one in bins["pitch_deg"]] == [50, 60, 70, 80, 90]


def test_the_visible_fraction_is_that_of_the_instrument_that_was_found():
    # Of three instruments in two images, only the last is detected and partly hidden.
    boxes = np.array([[0, 0, 10, 10], [50, 0, 60, 10]], dtype=float)
    nothing = Detections(np.empty((0, 4)), np.empty(0), np.empty((0, 5)))
    known = [Annotations(boxes[:1], TRUE[:1]), Annotations(boxes, TRUE[:2])]
    found = [nothing, Detections(boxes[1:], np.ones(1), TRUE[1:2])]
    bins = binned_errors(pose_errors(found, known), np.array([1.0, 1.0, 0.4]), np.ones(1), *LIMITS)
    assert [one.count for one in bins["visible_fraction"]] == [1, 0, 0, 0, 0]


def test_the_figure_shows_the_medians_of_bins_that_hold_enough():
    often = {
        name: [replace(one, count=5 * one.count) for one in row] for name, row in FOUND.items()
    }
    figure = binned_error_figure({"C": FOUND, "D": often})
    rarely, depth = (line.get_xydata() for line in figure.axes[0].lines)
    assert np.isnan(rarely[:, 1]).all()
    np.testing.assert_allclose(depth[:, 0], [12.5, 17.5, 22.5, 27.5, 32.5, 37.5])
    np.testing.assert_allclose(depth[:, 1], [2.0, *[np.nan] * 4, 4.0])
    assert all(axes.get_ylim()[0] == 0 and axes.get_ylim()[1] > 4.0 for axes in figure.axes[:5])
    turned = figure.axes[5].lines[1].get_ydata()  # axis errors by depth, below the tip errors
    np.testing.assert_allclose(turned, [0.0, *[np.nan] * 4, 3.0], atol=1e-6)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["C", "D"]


def test_the_figure_shows_the_bias_of_the_depth_where_it_was_measured():
    wrong = np.repeat(TRUE + np.outer([1, 3, 4, -2], [0, 0, 1, 0, 0]), 5, axis=0)
    errors = errors_between(wrong, np.repeat(TRUE, 5, axis=0))
    bins = binned_errors(errors, np.ones(20), np.ones(20), *LIMITS)
    old = {name: [replace(one, z_bias_mm=None) for one in row] for name, row in bins.items()}
    assert len(binned_error_figure({"C": old}).axes) == 10
    axes = binned_error_figure({"C": old, "D": bins}).axes[10]
    assert axes.get_ylabel() == "median signed z error [mm]"
    without, measured = (line.get_ydata() for line in axes.lines[:2])
    assert np.isnan(np.array(without, dtype=float)).all()
    np.testing.assert_allclose(measured, [3, *[np.nan] * 4, -2])
