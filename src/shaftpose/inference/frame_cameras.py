"""What the user states about the camera of the frames."""

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

from shaftpose.core.errors import InputError
from shaftpose.core.geometry import Camera
from shaftpose.inference.calibration import Calibration, read_calibration
from shaftpose.inference.views import CentreSquare, Resampled, View

Warn = Callable[[str], None]
# The camera of frames of a width and height.
FrameCamera = Callable[[int, int], Calibration]
# A view of frames of a width and height.
Views = Callable[[int, int], View]

_LEAST_COVERED = 0.95
_KEPT = 4  # views, of some MB each


def unknown_camera(model: Camera) -> Views:
    """Views of frames of unknown cameras: their central squares."""
    return lambda width, height: CentreSquare(width, height, model.width)


def known_camera(camera: FrameCamera, model: Camera, warn: Warn) -> Views:
    """Views of frames of a known camera, as the model's camera would have seen them.

    Warns if that camera sees clearly less than the model's.
    """

    @lru_cache(maxsize=_KEPT)
    def view(width: int, height: int) -> View:
        resampled = Resampled(camera(width, height), model)
        if resampled.covered < _LEAST_COVERED:
            warn(
                f"frames of {width} x {height} px fill only {resampled.covered:.0%} of the view "
                "that the model was trained for; the rest is black, which it has never seen"
            )
        return resampled

    return view


def stated_view(view_deg: float) -> FrameCamera:
    """A centred camera without distortion, for frames of any size."""
    return lambda width, height: Calibration.pinhole(width, height, view_deg)


def calibrated(path: Path) -> FrameCamera:
    """The camera in a calibration file.

    Raises InputError naming the file if it is no calibration; the camera raises one for frames of
    another size than its own.
    """
    calibration = read_calibration(path)

    def camera(width: int, height: int) -> Calibration:
        if (width, height) != (calibration.width, calibration.height):
            raise InputError(
                f"has {width} x {height} px, but {path} is the calibration of "
                f"{calibration.width} x {calibration.height} px; calibrate for these frames"
            )
        return calibration

    return camera
