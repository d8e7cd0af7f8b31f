"""How a frame becomes the square image that a model takes, and back."""

from functools import cached_property
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.core.geometry import Camera
from shaftpose.core.images import Image, centre_square
from shaftpose.inference.calibration import Calibration

Array = NDArray[np.float64]

# Samples per pixel and side, of a frame with more than `_ONE_SAMPLE` times the pixels: of others,
# linear interpolation averages enough.
_SAMPLES, _ONE_SAMPLE = 2, 1.5
# The fine square has at most this many times the pixels a side: more take longer than they gain.
_FINEST = 3


class View(Protocol):
    """The square image of a model within frames of one size."""

    def square(self, rgb: Image) -> Image:
        """The model's image (S, S, 3) of a frame (H, W, 3)."""

    def fine_square(self, rgb: Image) -> Image | None:
        """The same view (k S, k S, 3), with k = 2 or 3; None if the frame has less than twice the
        model's pixels per angle."""

    def image_px(self, points: Array) -> Array:
        """Pixels (N, 2) of the frame for pixels (N, 2) of the model's image."""


class CentreSquare:
    """The central square of a frame, whatever its camera."""

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
        """Pixels (N, 2) of the frame for pixels (N, 2) of the square."""
        return np.asarray(points * self._scale + self._corner)


class Resampled:
    """What a model's camera would have seen of a known camera's frame: without distortion, black
    where the frame ends.

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

    @cached_property  # its tables take some 30 MB, and many users' frames are never fitted
    def _fine(self) -> "_Resampling | None":
        times = _finer(self._calibration.matrix[0, 0] / self._model.focal_px)
        return _Resampling(self._calibration, self._model.enlarged(times)) if times > 1 else None

    def image_px(self, points: Array) -> Array:
        """Pixels (N, 2) of the frame, with its distortion, for pixels (N, 2) of the square."""
        centre = np.array([self._model.cx, self._model.cy])
        return self._calibration.image_px((points - centre) / self._model.focal_px)


def _finer(ratio: float) -> int:
    """How many times the model's pixels the fine square has a side, for the frame's ratio."""
    return min(int(ratio + 1e-6), _FINEST)  # a ratio of 2 may have been computed as 1.99...


class _Resampling:
    """Frames of one camera as another one would have seen them."""

    def __init__(self, calibration: Calibration, target: Camera) -> None:
        ratio = calibration.matrix[0, 0] / target.focal_px
        samples = _SAMPLES if ratio > _ONE_SAMPLE else 1
        x, y, inside = _places(calibration, target, samples)
        # Averaged to less than twice the density of the samples first, and these to pixels after:
        # no aliasing. OpenCV averages whole numbers of pixels ten times as fast as others.
        shrink = max(int(ratio / samples), 1)
        self._frame = _shrunk(calibration.width, shrink), _shrunk(calibration.height, shrink)
        x = (x + 0.5) * (self._frame[0] / calibration.width) - 0.5
        y = (y + 0.5) * (self._frame[1] / calibration.height) - 0.5
        self._places = cv2.convertMaps(x, y, cv2.CV_16SC2)
        self._outside, self.covered = ~inside, float(inside.mean())
        self._size = target.width, target.height

    def __call__(self, rgb: Image) -> Image:
        """The target camera's image of a frame (H, W, 3)."""
        if rgb.shape[1::-1] != self._frame:
            rgb = np.asarray(cv2.resize(rgb, self._frame, interpolation=cv2.INTER_AREA), np.uint8)
        dense = cv2.remap(rgb, *self._places, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        dense[self._outside] = 0
        return np.asarray(cv2.resize(dense, self._size, interpolation=cv2.INTER_AREA), np.uint8)


def _shrunk(length: int, by: int) -> int:
    return max(round(length / by), 1)


def _places(
    calibration: Calibration, model: Camera, samples: int
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_]]:
    """The x and y in a frame, for pixel centres at whole numbers, of `samples` x `samples` places
    in each of the model's pixels, and whether they are inside; each (samples S, samples S)."""
    width, height = samples * model.width, samples * model.height
    matrix = np.diag([samples, samples, 1.0]) @ model.matrix
    matrix[:2, 2] -= 0.5
    x, y = cv2.initUndistortRectifyMap(
        calibration.matrix, calibration.distortion, np.eye(3), matrix, (width, height), cv2.CV_32FC1
    )
    rays_x = (np.arange(width) - matrix[0, 2]) / matrix[0, 0]
    rays_y = (np.arange(height) - matrix[1, 2]) / matrix[1, 1]
    inside = np.hypot(rays_x, rays_y[:, None]) <= calibration.valid_radius
    inside &= (x >= -0.5) & (x <= calibration.width - 0.5)
    inside &= (y >= -0.5) & (y <= calibration.height - 0.5)
    return x.astype(np.float32, copy=False), y.astype(np.float32, copy=False), inside
