"""Views: the square image of a model within a frame, and the way back to the frame's pixels."""

from collections.abc import Callable
from functools import cached_property, lru_cache
from typing import Protocol

import cv2
import numpy as np

from shaftpose.core.geometry import Array, Camera
from shaftpose.core.images import Image, centre_square
from shaftpose.inference.calibration import Calibration
from shaftpose.inference.calibration_files import FrameCamera

# Samples per pixel and side of frames with more than `_ONE_SAMPLE` times the model's pixels. For
# others, linear interpolation averages enough.
_SAMPLES, _ONE_SAMPLE = 2, 1.5
# The fine square has at most this many times the pixels a side: more cost time and gain little.
_FINEST = 3
_LEAST_COVERED = 0.95
_CACHED = 4  # views, of some MB each


class View(Protocol):
    """The square image of a model, S x S px, within frames of one size, W x H px."""

    def square(self, rgb: Image) -> Image:
        """The model's image (S, S, 3) of a frame (H, W, 3)."""

    def fine_square(self, rgb: Image) -> Image | None:
        """The same view with k = 2 or 3 times the pixels a side, (k S, k S, 3); None if the frame
        has less than twice the model's pixels per angle."""

    def image_px(self, points: Array) -> Array:
        """Pixels (N, 2) of the frame from pixels (N, 2) of the model's image."""


# The view of frames of a width and height.
Views = Callable[[int, int], View]
Warn = Callable[[str], None]


class CentreSquare:
    """The central square of a frame of an unknown camera."""

    def __init__(self, width: int, height: int, side_px: int) -> None:
        self._side_px, side = side_px, min(width, height)
        self._scale = side / side_px
        # Whole pixels, as `centre_square` cuts.
        self._corner = np.array([(width - side) // 2, (height - side) // 2])

    def square(self, rgb: Image) -> Image:
        """The central square of a frame (H, W, 3), scaled."""
        return centre_square(rgb, self._side_px)

    def fine_square(self, rgb: Image) -> Image | None:
        """The central square with more pixels, if the frame has them."""
        times = _finer(self._scale)
        return centre_square(rgb, times * self._side_px) if times > 1 else None

    def image_px(self, points: Array) -> Array:
        """Pixels (N, 2) of the frame from pixels (N, 2) of the square."""
        return np.asarray(points * self._scale + self._corner)


class Resampled:
    """A known camera's frame resampled for the model's camera: without distortion, black where the
    frame ends.

    covered: the share of the model's image that the frame fills.
    """

    def __init__(self, calibration: Calibration, model: Camera) -> None:
        self._calibration, self._model = calibration, model
        self._square = _Resampling(calibration, model)
        self.covered = self._square.covered

    def square(self, rgb: Image) -> Image:
        """The model's image (S, S, 3) of a frame (H, W, 3)."""
        return self._square(rgb)

    def fine_square(self, rgb: Image) -> Image | None:
        """The model's image with more pixels, if the frame has them."""
        return None if self._fine is None else self._fine(rgb)

    @cached_property  # its tables take some 30 MB, and only the fit needs them
    def _fine(self) -> "_Resampling | None":
        times = _finer(self._calibration.focal_px / self._model.focal_px)
        return _Resampling(self._calibration, self._model.enlarged(times)) if times > 1 else None

    def image_px(self, points: Array) -> Array:
        """Pixels (N, 2) of the distorted frame from pixels (N, 2) of the square."""
        centre = np.array([self._model.cx, self._model.cy])
        return self._calibration.image_px((points - centre) / self._model.focal_px)


def _finer(ratio: float) -> int:
    """The whole number k of `View.fine_square`, 1 for none.

    ratio: the frame's pixels per angle over the model's.
    """
    return min(int(ratio + 1e-6), _FINEST)  # rounding may have turned 2 into 1.99...


class _Resampling:
    """Resamples frames of a calibrated camera for a pinhole camera that looks the same way."""

    def __init__(self, calibration: Calibration, target: Camera) -> None:
        ratio = calibration.focal_px / target.focal_px
        samples = _SAMPLES if ratio > _ONE_SAMPLE else 1
        x, y, inside = calibration.places_of(target, samples)
        # Against aliasing, the frame is averaged to less than twice the density of the samples, and
        # the samples are averaged to pixels. OpenCV averages blocks of whole pixels ten times as
        # fast as others.
        shrink = max(int(ratio / samples), 1)
        self._frame = _shrunk(calibration.width, shrink), _shrunk(calibration.height, shrink)
        x = (x + 0.5) * (self._frame[0] / calibration.width) - 0.5
        y = (y + 0.5) * (self._frame[1] / calibration.height) - 0.5
        self._maps = cv2.convertMaps(x, y, cv2.CV_16SC2)
        self._outside, self.covered = ~inside, float(inside.mean())
        self._size = target.width, target.height

    def __call__(self, rgb: Image) -> Image:
        """The target camera's image of a frame (H, W, 3)."""
        if rgb.shape[1::-1] != self._frame:
            rgb = np.asarray(cv2.resize(rgb, self._frame, interpolation=cv2.INTER_AREA), np.uint8)
        dense = cv2.remap(rgb, *self._maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        dense[self._outside] = 0
        return np.asarray(cv2.resize(dense, self._size, interpolation=cv2.INTER_AREA), np.uint8)


def _shrunk(length: int, by: int) -> int:
    return max(round(length / by), 1)


def unknown_camera(model: Camera) -> Views:
    """Views of an unknown camera's frames: their central squares."""
    return lambda width, height: CentreSquare(width, height, model.width)


def known_camera(camera: FrameCamera, model: Camera, warn: Warn) -> Views:
    """Views of a known camera's frames, resampled for the model's camera.

    Warns if the known camera sees clearly less than the model's.
    """

    @lru_cache(maxsize=_CACHED)
    def view(width: int, height: int) -> View:
        resampled = Resampled(camera(width, height), model)
        if resampled.covered < _LEAST_COVERED:
            warn(
                f"frames of {width} x {height} px fill only {resampled.covered:.0%} of the view "
                "that the model was trained for; the rest is black, which it has never seen"
            )
        return resampled

    return view
