"""Rays and pixels of a calibrated camera."""

import numpy as np
import pytest

from shaftpose.inference.calibration import Calibration


def test_rays_become_pixels() -> None:
    """400 x 300 px and 90 deg across 300 px: the focal length is 150 px, the middle (200, 150)."""
    rays = np.array([[0, 0], [0.5, 0], [0.5, -0.2]])
    plain = Calibration.pinhole(400, 300, 90.0)
    assert plain.image_px(rays).tolist() == pytest.approx(
        np.array([[200, 150], [275, 150], [275, 120]])
    )
    # k1 = 0.1 at r = 0.5 stretches by 1.025, p1 = 0.01 moves by 0.01 r^2 along y.
    bent = Calibration(400, 300, plain.matrix, np.array([0.1, 0, 0.01, 0]))
    assert bent.image_px(rays[1:2])[0] == pytest.approx([276.875, 150.375])


def test_rays_beyond_the_fold_of_a_distortion_are_moved_to_it() -> None:
    """r (1 - 0.1 r^2) grows up to r = sqrt(10 / 3) = 1.826, where it is 1.217."""
    plain = Calibration.pinhole(400, 300, 90.0)
    assert plain.valid_radius == np.inf
    barrel = Calibration(400, 300, plain.matrix, np.array([-0.1, 0, 0, 0]))
    assert barrel.valid_radius == pytest.approx(1.826, abs=2e-3)
    assert barrel.image_px(np.array([[0.0, 5.0]]))[0] == pytest.approx(
        [200, 150 + 150 * 1.217], abs=0.1
    )


@pytest.mark.parametrize("view_deg", [60.0, 95.0, 120.0])
def test_a_centred_pinhole_sees_the_whole_of_its_square(view_deg: float) -> None:
    camera = Calibration.pinhole(640, 480, view_deg)
    assert camera.widest_view_deg() == pytest.approx(view_deg, abs=0.02)


def test_an_axis_off_the_centre_narrows_the_view() -> None:
    """The nearest border is 100 px from the axis: an angle of 2 atan(100 / 200)."""
    matrix = np.array([[200.0, 0, 99.5], [0, 200, 239.5], [0, 0, 1]])
    camera = Calibration(640, 480, matrix, np.zeros(0))
    assert camera.widest_view_deg() == pytest.approx(53.13, abs=0.02)


def test_barrel_distortion_widens_the_view() -> None:
    """The middle of a side is distorted less than its ends, and leaves the frame first: where
    f t (1 + k1 t^2) is half of the side."""
    matrix = np.array([[400.0, 0, 239.5], [0, 400, 239.5], [0, 0, 1]])
    camera = Calibration(480, 480, matrix, np.array([-0.1, 0, 0, 0]))
    tangent = np.tan(np.radians(camera.widest_view_deg() / 2))
    assert tangent * (1 - 0.1 * tangent**2) == pytest.approx(240 / 400, abs=2e-4)
