"""What the user states about the camera."""

from pathlib import Path

import numpy as np
import pytest

from shaftpose.core.errors import InputError
from shaftpose.core.geometry import Camera
from shaftpose.inference.frame_cameras import calibrated, known_camera, stated_view
from tests.inference.test_calibration import FILE

MODEL = Camera.from_field_of_view(299, 299, 95.0)


def test_a_calibration_is_for_frames_of_its_own_size(tmp_path: Path) -> None:
    path = tmp_path / "cam.yaml"
    path.write_text(FILE)
    camera = calibrated(path)
    assert camera(640, 480).matrix[0, 0] == 500
    for width, height in ((1280, 960), (480, 640), (640, 360)):
        with pytest.raises(InputError, match=f"has {width} x {height} px, .* of 640 x 480 px"):
            camera(width, height)


def test_a_stated_view_is_that_of_the_central_square() -> None:
    """At 90 deg the focal length is half of the shorter side."""
    camera = stated_view(90.0)(1920, 1080)
    assert camera.matrix == pytest.approx(np.array([[540, 0, 959.5], [0, 540, 539.5], [0, 0, 1]]))


def test_a_camera_that_sees_less_than_the_model_is_warned_of_once() -> None:
    warnings: list[str] = []
    views = known_camera(stated_view(60.0), MODEL, warnings.append)
    assert views(299, 299) is views(299, 299)
    assert len(warnings) == 1
    assert "299 x 299 px fill only 28% of the view" in warnings[0]
    known_camera(stated_view(95.0), MODEL, warnings.append)(1920, 1080)
    assert len(warnings) == 1
