"""Frames as the square images of a model, and back."""

import numpy as np
import pytest
from numpy.typing import NDArray

from shaftpose.core.geometry import Camera
from shaftpose.core.images import Image
from shaftpose.inference.calibration import Calibration
from shaftpose.inference.calibration_files import stated_view
from shaftpose.inference.views import CentreSquare, Resampled, known_camera

MODEL = Camera.from_field_of_view(299, 299, 95.0)


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
    view = Resampled(camera, MODEL)
    found = view.square(photograph(camera, 0.05)).astype(float)
    # The model's corners, 1.54 = tan 57 deg from the axis, are at 1.72 f = 517 px, still inside.
    assert view.covered > 0.99
    inside = np.abs(found - expected()[..., None])[2:-2, 2:-2]
    assert inside.max() < 2.5
    assert inside.mean() < 0.5


def test_the_models_own_camera_changes_nothing() -> None:
    image = np.random.default_rng(3).integers(0, 256, (299, 299, 3), dtype=np.uint8)
    view = Resampled(Calibration.pinhole(299, 299, 95.0), MODEL)
    np.testing.assert_array_equal(view.square(image), image)
    assert view.covered == 1.0
    assert view.image_px(np.array([[12.0, 250.5]]))[0] == pytest.approx([12.0, 250.5])


def test_what_a_narrow_camera_does_not_see_is_black() -> None:
    """60 deg across 200 px: tan 30 / tan 47.5 = 0.529 of the model's side, 158 px."""
    view = Resampled(Calibration.pinhole(200, 200, 60.0), MODEL)
    square = view.square(np.full((200, 200, 3), 200, dtype=np.uint8))
    lit = square[..., 0] > 100
    assert lit.any(axis=0).sum() == lit.any(axis=1).sum() == pytest.approx(158, abs=1)
    assert lit[149, 149] and square[0, 0, 0] == 0
    assert view.covered == pytest.approx(0.529**2, abs=0.005)


def test_nothing_is_seen_beyond_the_fold_of_a_distortion() -> None:
    """k1 = -0.3 folds at r = 1.054, between the model's sides (1.09) and its middle."""
    plain = Calibration.pinhole(600, 600, 100.0)
    view = Resampled(Calibration(600, 600, plain.matrix, np.array([-0.3, 0, 0, 0])), MODEL)
    square = view.square(np.full((600, 600, 3), 200, dtype=np.uint8))
    assert not square[0].any() and not square[:, 0].any()
    assert square[149, 149 + 140].all()


def test_pixels_lead_back_through_the_lens() -> None:
    """(299, 149.5) is the ray (1.0913, 0), which k1 = 0.05 stretches by 1.0595."""
    camera = Calibration(
        840, 800, np.array([[300, 0, 430], [0, 310, 380], [0, 0, 1.0]]), np.array([0.05, 0, 0, 0])
    )
    found = Resampled(camera, MODEL).image_px(np.array([[149.5, 149.5], [299.0, 149.5]]))
    assert found[0] == pytest.approx([430.5, 380.5])
    assert found[1] == pytest.approx([430.5 + 300 * 1.0913 * 1.05955, 380.5], abs=0.05)


def test_the_central_square_leads_back() -> None:
    """Of 1000 x 600 px: 600 px wide, from column 200."""
    view = CentreSquare(1000, 600, 300)
    assert view.image_px(np.array([[0.0, 0.0], [300, 300], [10, 20]])).tolist() == [
        [200, 0], [800, 600], [220, 40],
    ]  # fmt: skip
    frame = np.zeros((600, 1000, 3), dtype=np.uint8)
    frame[:, 200:800] = 50
    assert (view.square(frame) == 50).all()


def test_a_known_cameras_further_pixels_are_used() -> None:
    matrix = np.array([[300, 0, 430], [0, 310, 380], [0, 0, 1.0]])
    camera = Calibration(840, 800, matrix, np.array([0.05, 0, 0, 0]))
    found = Resampled(camera, MODEL).fine_square(photograph(camera, 0.05))
    assert found is not None and found.shape == (598, 598, 3)  # 300 px are 2.2 focal lengths
    assert np.abs(found - expected(2)[..., None])[4:-4, 4:-4].max() < 2.5


@pytest.mark.parametrize(
    ("width", "height", "side_px"), [(1920, 1080, 897), (700, 600, 598), (800, 590, None)]
)
def test_a_square_has_up_to_three_times_the_models_pixels(
    width: int, height: int, side_px: int | None
) -> None:
    frame = np.random.default_rng(0).integers(0, 256, (height, width, 3), dtype=np.uint8)
    fine = CentreSquare(width, height, 299).fine_square(frame)
    assert (None if fine is None else fine.shape) == (side_px and (side_px, side_px, 3))
    calibration = Calibration.pinhole(299, 299, 95.0)
    assert Resampled(calibration, MODEL).fine_square(frame[:299, :299]) is None


def test_a_camera_that_sees_less_than_the_model_is_warned_of_once() -> None:
    warnings: list[str] = []
    views = known_camera(stated_view(60.0), MODEL, warnings.append)
    assert views(299, 299) is views(299, 299)
    assert len(warnings) == 1
    assert "299 x 299 px fill only 28% of the view" in warnings[0]
    known_camera(stated_view(95.0), MODEL, warnings.append)(1920, 1080)
    assert len(warnings) == 1
