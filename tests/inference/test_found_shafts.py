"""Shafts in pixels of the frame."""

import numpy as np
import pytest

from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.inference.calibration import Calibration
from shaftpose.inference.found_shafts import axis_points, axis_px, box_px
from shaftpose.inference.frame_views import views
from shaftpose.inference.views import View

MODEL = Camera.from_field_of_view(300, 300, 90.0)  # a focal length of 150 px


def central_square(width: int, height: int) -> View:
    """The view of a model of squares of an unknown camera's frames."""
    return views(None, MODEL, None, None, lambda _: None)(width, height, 1.0)


def test_the_axis_begins_at_the_tip_and_ends_10_mm_behind_it() -> None:
    pose = ShaftPose(2.0, -4.0, 20.0, 90.0, 0.0)
    assert axis_points(pose) == pytest.approx(np.array([[2, -4, 20], [12, -4, 20]]))
    # Twice the model's pixels, from column 100: 2 * (150 * 2 / 20 + 150) + 100 = 430.
    found = axis_px(pose, central_square(800, 600))
    assert found == pytest.approx(np.array([[430, 240], [580, 240]]))


def test_the_axis_ends_before_half_of_the_tips_depth() -> None:
    """Pitch 0: straight towards the camera. Pitch 180: away from it."""
    assert axis_points(ShaftPose(1, 2, 12, 0, 0))[1] == pytest.approx([1, 2, 6])
    assert axis_points(ShaftPose(1, 2, 12, 180, 0))[1] == pytest.approx([1, 2, 22])


def test_a_tip_behind_the_camera_has_finite_pixels() -> None:
    found = axis_px(ShaftPose(1, 2, -5, 60, 0), central_square(300, 300))
    assert np.isfinite(found).all()


def test_pixels_do_not_depend_on_the_unit_of_length() -> None:
    view = central_square(300, 300)
    for tip in ((2.0, -4.0, 20.0), (2.0, -4.0, -20.0), (30.0, 0.0, 0.1)):
        large, small = (
            axis_px(ShaftPose(*(unit * np.array(tip)).tolist(), 90.0, 30.0), view)[0]
            for unit in (1.0, 1e-3)
        )
        assert small == pytest.approx(large)


def test_a_box_is_clipped_to_the_frame() -> None:
    view = central_square(800, 600)
    box = box_px(np.array([-90.0, 10, 100, 320]), view, 800, 600)
    assert box == pytest.approx([0, 20, 300, 600])


def test_a_box_is_the_extent_of_what_a_lens_makes_of_it() -> None:
    """Pincushion k1 = 0.1: a side's middle (0.8, 0) moves to 0.8512, its corner (0.8, 0.8) to
    0.9024, which is farther out. Barrel: the middle is."""
    plain = Calibration.pinhole(600, 600, 90.0)  # 300 px
    box = np.array([30.0, 30, 270, 270])
    for k1, reach in ((0.1, 0.8 * (1 + 0.1 * 1.28)), (-0.1, 0.8 * (1 - 0.1 * 0.64))):
        view = View(Calibration(600, 600, plain.matrix, np.array([k1, 0, 0, 0])), MODEL)
        low, high = 300 - 300 * reach, 300 + 300 * reach
        assert box_px(box, view, 600, 600) == pytest.approx([low, low, high, high], abs=0.01)
