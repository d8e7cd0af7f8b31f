"""Frames as the images of a model, and back."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from shaftpose.core.errors import InputError
from shaftpose.core.geometry import Camera
from shaftpose.core.images import Image
from shaftpose.inference.calibration import Calibration
from shaftpose.inference.calibration_files import CameraFile, FrameCamera, stated_view
from shaftpose.inference.frame_views import Crop, Views, views
from shaftpose.inference.views import View

MODEL = Camera.from_field_of_view(299, 299, 95.0)


def whole(view_deg: float | None, crop: Crop | None = None) -> Views:
    """Views of whole frames of a stated or unknown camera, of which nothing is cut."""

    def fail(message: str) -> None:
        raise AssertionError(message)

    camera = None if view_deg is None else stated_view(view_deg)
    return views(camera, MODEL, MODEL.width, crop, fail)


def central_square(width: int, height: int) -> View:
    """The view of a model of squares of an unknown camera's frames."""
    return views(None, MODEL, None, None, lambda _: None)(width, height, 1.0)


def pattern(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """The brightness of a scene by the direction from which it is seen."""
    return 128 + 60 * np.sin(4 * x) + 50 * np.cos(3 * y + x)


def photograph(camera: Calibration, k1: float) -> Image:
    """The scene in a camera of radial distortion k1, inverted by a table."""
    x = (np.arange(camera.width) - camera.matrix[0, 2]) / camera.matrix[0, 0]
    y = (np.arange(camera.height) - camera.matrix[1, 2]) / camera.matrix[1, 1]
    x, y = np.meshgrid(x, y)
    table = np.linspace(0, 3, 30_001)
    seen = np.hypot(x, y)
    ratio = np.interp(seen, table * (1 + k1 * table**2), table) / np.maximum(seen, 1e-9)
    grey = np.rint(pattern(x * ratio, y * ratio)).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=2)


def expected(times: int = 1) -> NDArray[np.float64]:
    """The scene in the model's camera, with `times` as many pixels a side."""
    side_px = 299 * times
    steps = (np.arange(side_px) + 0.5 - side_px / 2) / (times * MODEL.focal_px)
    return pattern(*np.meshgrid(steps, steps))


def test_a_known_camera_is_seen_as_the_models() -> None:
    """Of an own focal length, middle and distortion, in pixels that are not square."""
    matrix = np.array([[300, 0, 430], [0, 310, 380], [0, 0, 1.0]])
    camera = Calibration(840, 800, matrix, np.array([0.05, 0, 0, 0]))
    view = View(camera, MODEL)
    found = view.picture(photograph(camera, 0.05)).astype(float)
    # The model's corners, 1.54 = tan 57 deg from the axis, are at 1.72 f = 517 px, still inside.
    assert view.covered > 0.99
    inside = np.abs(found - expected()[..., None])[2:-2, 2:-2]
    assert inside.max() < 2.5
    assert inside.mean() < 0.5


def test_the_models_own_camera_changes_nothing() -> None:
    image = np.random.default_rng(3).integers(0, 256, (299, 299, 3), dtype=np.uint8)
    view = View(Calibration.pinhole(299, 299, 95.0), MODEL)
    np.testing.assert_array_equal(view.picture(image), image)
    assert view.covered == 1.0
    assert view.image_px(np.array([[12.0, 250.5]]))[0] == pytest.approx([12.0, 250.5])


def test_what_a_narrow_camera_does_not_see_is_black() -> None:
    """60 deg across 200 px: tan 30 / tan 47.5 = 0.529 of the model's side, 158 px."""
    view = View(Calibration.pinhole(200, 200, 60.0), MODEL)
    square = view.picture(np.full((200, 200, 3), 200, dtype=np.uint8))
    lit = square[..., 0] > 100
    assert lit.any(axis=0).sum() == lit.any(axis=1).sum() == pytest.approx(158, abs=1)
    assert lit[149, 149] and square[0, 0, 0] == 0
    assert view.covered == pytest.approx(0.529**2, abs=0.005)


def test_nothing_is_seen_beyond_the_fold_of_a_distortion() -> None:
    """k1 = -0.3 folds at r = 1.054, between the model's sides (1.09) and its middle."""
    plain = Calibration.pinhole(600, 600, 100.0)
    view = View(Calibration(600, 600, plain.matrix, np.array([-0.3, 0, 0, 0])), MODEL)
    square = view.picture(np.full((600, 600, 3), 200, dtype=np.uint8))
    assert not square[0].any() and not square[:, 0].any()
    assert square[149, 149 + 140].all()


def test_pixels_lead_back_through_the_lens() -> None:
    """(299, 149.5) is the ray (1.0913, 0), which k1 = 0.05 stretches by 1.0595."""
    camera = Calibration(
        840, 800, np.array([[300, 0, 430], [0, 310, 380], [0, 0, 1.0]]), np.array([0.05, 0, 0, 0])
    )
    found = View(camera, MODEL).image_px(np.array([[149.5, 149.5], [299.0, 149.5]]))
    assert found[0] == pytest.approx([430.5, 380.5])
    assert found[1] == pytest.approx([430.5 + 300 * 1.0913 * 1.05955, 380.5], abs=0.05)


def test_the_central_square_leads_back() -> None:
    """Of 1000 x 600 px: 600 px wide, from column 200."""
    view = central_square(1000, 598)
    ends = view.image_px(np.array([[0.0, 0.0], [299, 299], [10, 20]]))
    np.testing.assert_allclose(ends, [[201, 0], [799, 598], [221, 40]])
    frame = np.zeros((598, 1000, 3), dtype=np.uint8)
    frame[:, 201:799] = 50
    assert (view.picture(frame) == 50).all()


def test_a_known_cameras_further_pixels_are_used() -> None:
    matrix = np.array([[300, 0, 430], [0, 310, 380], [0, 0, 1.0]])
    camera = Calibration(840, 800, matrix, np.array([0.05, 0, 0, 0]))
    found = View(camera, MODEL).fine_picture(photograph(camera, 0.05))
    assert found is not None and found.shape == (598, 598, 3)  # 300 px are 2.2 focal lengths
    assert np.abs(found - expected(2)[..., None])[4:-4, 4:-4].max() < 2.5


@pytest.mark.parametrize(
    ("width", "height", "side_px"), [(1920, 1080, 897), (700, 600, 598), (800, 590, None)]
)
def test_a_square_has_up_to_three_times_the_models_pixels(
    width: int, height: int, side_px: int | None
) -> None:
    frame = np.random.default_rng(0).integers(0, 256, (height, width, 3), dtype=np.uint8)
    fine = central_square(width, height).fine_picture(frame)
    assert (None if fine is None else fine.shape) == (side_px and (side_px, side_px, 3))
    calibration = Calibration.pinhole(299, 299, 95.0)
    assert View(calibration, MODEL).fine_picture(frame[:299, :299]) is None


@pytest.mark.parametrize(
    ("width", "height", "aspect", "crop", "warned"),
    [
        (1280, 480, 1.0, None, True),  # two pictures of 4:3
        (720, 576, 2.0, None, True),  # two of 5:4, stored in half the width
        (1280, 480, 1.0, (0, 0, 640, 480), False),
        (3840, 1600, 1.0, None, False),  # the widest usual screen
    ],
)
@pytest.mark.parametrize("camera", [None, stated_view(65.0)], ids=["unknown", "stated"])
def test_frames_as_wide_as_two_pictures_may_be_of_a_stereo_camera(
    width: int,
    height: int,
    aspect: float,
    crop: Crop | None,
    warned: bool,
    camera: FrameCamera | None,
) -> None:
    warnings: list[str] = []
    views(camera, MODEL, 299, crop, warnings.append)(width, height, aspect)
    hint = (
        f"frames of {width} x {height} px are as wide as two pictures: if they are the two eyes of "
        "a stereo camera, choose one by --crop"
    )
    assert warnings == ([hint] if warned else [])


def test_a_camera_that_sees_less_than_the_model_is_warned_of_once() -> None:
    warnings: list[str] = []
    narrow = views(stated_view(60.0), MODEL, None, None, warnings.append)
    assert narrow(299, 299, 1.0) is narrow(299, 299, 1.0)
    assert len(warnings) == 1
    assert "299 x 299 px fill only 28% of the view" in warnings[0]
    views(stated_view(95.0), MODEL, None, None, warnings.append)(1920, 1080, 1.0)
    assert len(warnings) == 1


def test_a_network_of_any_size_sees_the_whole_frame_of_a_known_camera() -> None:
    """16:9 at the model's focal length: 95 deg across 1080 px are 299 px, 1920 px are 531.6."""
    view = whole(95.0)(1920, 1080, 1.0)
    assert (view.camera.width, view.camera.height) == (531, 299)
    assert view.camera.focal_px == MODEL.focal_px
    ends = view.image_px(np.array([[0.0, 0], [531.56, 299]]))
    np.testing.assert_allclose(ends, [[0, 0], [1920, 1080]], atol=0.2)
    assert view.picture(np.full((1080, 1920, 3), 9, np.uint8)).min() == 9


def test_a_camera_off_its_axis_is_seen_whole() -> None:
    matrix = np.array([[300, 0, 250.0], [0, 300, 199.5], [0, 0, 1]])
    camera = Calibration(640, 400, matrix, np.zeros(0)).undistorted(150.0)
    assert (camera.width, camera.height) == (320, 200)
    assert (camera.cx, camera.cy) == pytest.approx((125.25, 100.0), abs=0.01)


@pytest.mark.parametrize("k1", [-0.15, 0.15])
def test_an_undistorted_picture_has_no_black_border(k1: float) -> None:
    plain = Calibration.pinhole(640, 480, 70.0)
    camera = Calibration(640, 480, plain.matrix, np.array([k1, 0, 0, 0]))
    view = View(camera, camera.undistorted(200.0))
    assert view.covered > 0.999
    assert view.picture(np.full((480, 640, 3), 9, np.uint8)).min() == 9
    # Barrel distortion moves the ray through the middle of the right side inwards, t (1 + k1 t^2).
    tangent = view.camera.cx / 200
    reach = np.tan(np.radians(35)) * 640 / 480
    assert tangent * (1 + k1 * tangent**2) <= reach + 1e-3
    if k1 < 0:
        assert tangent * (1 + k1 * tangent**2) == pytest.approx(reach, abs=1e-3)


def test_what_a_wide_camera_loses_is_said() -> None:
    said: list[str] = []
    views(stated_view(150.0), MODEL, MODEL.width, None, said.append)(640, 480, 1.0)
    assert len(said) == 1 and "see more than 140 deg" in said[0]


def test_an_unknown_cameras_frame_is_scaled_to_the_models_side() -> None:
    view = whole(None)(1280, 720, 1.0)
    assert (view.camera.width, view.camera.height) == (532, 299)
    ends = view.image_px(np.array([[0.0, 0.0], [266.0, 149.5], [532.0, 299.0]]))
    np.testing.assert_allclose(ends, [[0, 0], [640, 360], [1280, 720]], atol=1e-9)
    fine = view.fine_picture(np.zeros((720, 1280, 3), np.uint8))
    assert fine is not None and fine.shape == (598, 1064, 3)
    for camera, width in ((None, 427), (stated_view(95.0), 426)):
        smaller = views(camera, MODEL, 240, None, lambda _: None)(1280, 720, 1.0)
        assert (smaller.camera.width, smaller.camera.height) == (width, 240)


@pytest.mark.parametrize(("width", "height", "said"), [(63, 200, "at least 64"), (600, 100, "4:1")])
def test_frames_that_are_too_small_or_too_long_are_named(
    width: int, height: int, said: str
) -> None:
    with pytest.raises(InputError, match=said):
        whole(None)(width, height, 1.0)


@pytest.mark.parametrize("view_deg", [None, 2.0, 95.0])
@pytest.mark.parametrize("height", [64, 2598])
def test_frames_of_just_four_to_one_are_seen(height: int, view_deg: float | None) -> None:
    camera = None if view_deg is None else stated_view(view_deg)
    view = views(camera, MODEL, MODEL.width, None, lambda _: None)(4 * height, height, 1.0)
    assert view.camera.height == MODEL.height


@pytest.mark.parametrize(
    ("width", "height", "aspect", "square"),
    [(720, 576, 64 / 45, (1024, 576)), (720, 480, 8 / 9, (640, 480))],
)
@pytest.mark.parametrize("view_deg", [None, 80.0])
def test_oblong_pixels_are_seen_as_square_ones(
    width: int, height: int, aspect: float, square: tuple[int, int], view_deg: float | None
) -> None:
    view, twin = whole(view_deg)(width, height, aspect), whole(view_deg)(*square, 1.0)
    assert np.array([view.camera.width, view.camera.height]) == pytest.approx(
        np.array([twin.camera.width, twin.camera.height])
    )
    assert view.camera.focal_px == pytest.approx(twin.camera.focal_px)
    corners = np.array([[0.0, 0.0], [view.camera.width, view.camera.height], [100.0, 200.0]])
    stretch = np.array(square) / [width, height]
    np.testing.assert_allclose(view.image_px(corners) * stretch, twin.image_px(corners), atol=0.01)
    assert view.image_px(corners)[1] == pytest.approx([width, height], abs=2)
    frame = np.zeros((height, width, 3), np.uint8)
    frame[:, : width // 4] = 200
    assert (view.picture(frame)[..., 0] > 100).mean() == pytest.approx(1 / 4, abs=0.005)


def test_a_calibration_knows_the_shape_of_its_pixels(tmp_path: Path) -> None:
    matrix = np.array([[500, 0, 359.5], [0, 700, 287.5], [0, 0, 1.0]])
    camera = CameraFile(tmp_path / "camera.yaml", (720, 576), matrix, np.zeros(0), False)
    seen = views(camera, MODEL, MODEL.width, None, lambda _: None)
    assert seen(720, 576, 64 / 45).camera == seen(720, 576, 1.0).camera


def test_a_part_of_a_frame_is_seen_as_a_frame() -> None:
    parts = whole(None, (100, 50, 400, 300))
    view = parts(640, 480, 1.0)
    assert view.image_px(np.array([[0.0, 0], [399, 299]])) == pytest.approx(
        np.array([[100, 50], [500, 350]]), abs=0.01
    )
    assert view.frame_matrix[:2, 2] == pytest.approx([300, 200])
    frame = np.zeros((480, 640, 3), np.uint8)
    frame[50:350, 100:500] = 7
    assert view.picture(frame).min() == 7
    with pytest.raises(InputError, match="320 x 240 px, which do not hold --crop 100,50,400,300"):
        parts(320, 240, 1.0)


def test_a_part_of_oblong_pixels_is_seen_as_square_ones() -> None:
    """300 x 288 px are 426.7 x 288 square ones, and these 442.96 x 299 of the model's."""
    view = whole(None, (60, 20, 300, 288))(720, 576, 64 / 45)
    assert (view.camera.width, view.camera.height) == (443, 299)
    ends = view.image_px(np.array([[0.0, 0.0], [443.0, 299.0]]))
    np.testing.assert_allclose(ends, [[60, 20], [360, 308]], atol=0.01)


def test_a_part_that_does_not_fit_the_camera_is_named() -> None:
    with pytest.raises(InputError, match="--crop 0,0,400,60: has 400 x 60 px"):
        whole(95.0, (0, 0, 400, 60))(640, 480, 1.0)


def test_the_shorter_side_is_scaled_to_the_training_images_whatever_the_camera() -> None:
    for view_deg, focal in ((10.0, 1709.0), (63.34, 242.4)):
        camera = whole(view_deg)(1920, 1080, 1.0).camera
        assert (camera.width, camera.height) == pytest.approx((531, 299), abs=1)
        assert camera.focal_px == pytest.approx(focal, rel=0.01)


def test_a_network_of_squares_says_that_it_sees_the_central_one() -> None:
    warnings: list[str] = []
    squares = views(None, MODEL, None, None, warnings.append)
    assert squares(299, 299, 1.0).camera == MODEL and not warnings
    assert squares(1280, 720, 1.0) is squares(1280, 720, 1.0)
    assert len(warnings) == 1 and "this model sees squares" in warnings[0]
    squares(405, 576, 64 / 45)  # 576 x 576 square px
    assert len(warnings) == 1
    squares(576, 576, 64 / 45)
    assert len(warnings) == 2
