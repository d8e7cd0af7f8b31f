"""Rays and pixels of a calibrated camera."""

import cv2
import numpy as np
import pytest

from shaftpose.core.errors import InputError
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


def fisheye(focal_px: float, k1: float = 0.0) -> Calibration:
    matrix = np.array([[focal_px, 0, 319.5], [0, focal_px, 239.5], [0, 0, 1]])
    return Calibration(640, 480, matrix, np.array([k1, 0, 0, 0]), fisheye=True)


def test_a_fisheye_lens_turns_angles_into_pixels() -> None:
    """A ray 45 deg from the axis, at 200 px a radian: 157.08 px, and 1 + 0.1 * 0.617 of it."""
    rays = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, -1.0]])
    assert fisheye(200.0).image_px(rays) == pytest.approx(
        np.array([[320, 240], [477.08, 240], [320, 82.92]]), abs=0.01
    )
    assert fisheye(200.0, 0.1).image_px(rays[1:2])[0] == pytest.approx([486.77, 240], abs=0.01)


@pytest.mark.parametrize("k1", [0.0, -0.05])
def test_a_fisheye_frame_is_undistorted_and_leads_back(k1: float) -> None:
    """A dot at the pixel of a ray lies at f (x, y) in the undistorted picture."""
    camera, ray = fisheye(200.0, k1), np.array([[0.7, -0.4]])
    (seen,) = camera.image_px(ray)
    frame = np.zeros((480, 640), np.uint8)
    cv2.circle(frame, np.rint(seen - 0.5).astype(int).tolist(), 3, 255, cv2.FILLED)
    pinhole = camera.undistorted(150.0)
    places = camera.places_of(pinhole, 1)
    picture = cv2.remap(frame, places.x, places.y, cv2.INTER_LINEAR)
    found = np.argwhere(picture > 128)[:, ::-1].mean(axis=0) + 0.5
    assert found == pytest.approx(150 * ray[0] + [pinhole.cx, pinhole.cy], abs=1)
    assert places.inside.mean() > 0.99


@pytest.mark.parametrize(
    ("focal_px", "centre", "k1", "complaint"),
    [
        (
            300.0,
            (700.0, 200.0),
            0.0,
            r"point \[700.0, 200.0\] lies outside of its frames",
        ),
        (300.0, (320.0, -1.0), 0.0, "lies outside of its frames of 640 x 480 px"),
        (300.0, (320.0, 240.0), -0.8, "folds back 129 px from the principal point, within"),
        (300.0, (320.0, 240.0), -1e300, "folds back 0 px"),
        (300.0, (320.0, 240.0), 1e6, "without lens distortion, [0-9]+ x [0-9]+ px are left"),
        (1e-9, (320.0, 240.0), 0.0, "focal length of 1e-09 px is not that of frames"),
        (1e300, (320.0, 240.0), 0.0, "focal length of 1e[+]300 px"),
    ],
)
def test_a_camera_that_cannot_be_that_of_its_frames_is_named(
    focal_px: float, centre: tuple[float, float], k1: float, complaint: str
) -> None:
    """r (1 - 0.8 r^2) is largest at r^2 = 1 / 2.4, 0.43 focal lengths from the axis."""
    matrix = np.array([[focal_px, 0, centre[0]], [0, focal_px, centre[1]], [0, 0, 1]])
    with pytest.raises(InputError, match=complaint):
        Calibration(640, 480, matrix, np.array([k1, 0, 0, 0])).check()


@pytest.mark.parametrize("lens", [(0, 0, -0.5, 0), (0, 0, 0.5, 0), (0, 0, 0, -0.5), (0, 0, 0, 0.5)])
def test_a_distortion_may_fold_back_on_one_side(lens: tuple[float, ...]) -> None:
    """Along one axis, the distortion of p = 0.5 is r - 1.5 r^2: largest at a third of the focal
    length, where it is a sixth."""
    matrix = np.array([[600.0, 0, 319.5], [0, 600, 239.5], [0, 0, 1]])
    with pytest.raises(InputError, match="folds back 100 px"):
        Calibration(640, 480, matrix, np.array(lens)).check()


def test_what_is_cut_from_frames_is_said() -> None:
    """k1 = -0.1 folds back 1.217 focal lengths from the axis, in the corners alone; 320 px are 70
    deg at 262 px a radian."""
    whole = Calibration.pinhole(640, 480, 70.0)
    whole.check()
    assert whole.cuts() == []
    folding = Calibration(640, 480, np.diag([300.0, 300, 1]) + whole.matrix * [[0, 0, 1]],
                          np.array([-0.1, 0, 0, 0]))  # fmt: skip
    folding.check()
    assert folding.cuts() == [
        "the lens distortion folds back 365 px from the principal point: what lies farther away in "
        "frames of 640 x 480 px is not seen"
    ]
    assert fisheye(265.0).cuts() == []
    (cut,) = fisheye(255.0).cuts()
    assert cut.startswith("frames of 640 x 480 px see more than 140 deg: what lies beyond")


def test_of_two_focal_lengths_the_wrong_one_is_named() -> None:
    matrix = np.array([[2.0, 0, 320], [0, 5, 240], [0, 0, 1]])
    with pytest.raises(InputError, match="a focal length of 2 px"):
        Calibration(640, 480, matrix, np.zeros(0)).check()
