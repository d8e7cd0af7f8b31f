"""Views: a model's image of a frame, its camera, and the way back to the frame's pixels."""

from collections.abc import Callable
from functools import cached_property, partial

import cv2
import numpy as np

from shaftpose.core.geometry import Array, Camera
from shaftpose.core.images import Image, resized
from shaftpose.inference.calibration import Calibration

# Samples per pixel and side of frames with more than `_ONE_SAMPLE` times the model's pixels. For
# others, linear interpolation averages enough.
_SAMPLES, _ONE_SAMPLE = 2, 1.5
# The fine picture has at most this many times the pixels a side: more cost time and gain little.
_FINEST = 3


class View:
    """The image that a pinhole camera would have seen in the place of a calibrated camera: without
    distortion, black where the frame ends.

    calibration: of a part of the frames. camera: the pinhole, whose image of w x h px is the
    model's. corner: x, y of the part's first pixel. scaled: whether the image is just the part in
    another size, as of an unknown camera. covered: the share of the image that the part fills.
    """

    def __init__(
        self,
        calibration: Calibration,
        camera: Camera,
        corner: tuple[int, int] = (0, 0),
        scaled: bool = False,
    ) -> None:
        self._calibration, self.camera, self._corner = calibration, camera, corner
        self._scaled = scaled
        self._resample, self.covered = self._resampling(camera)

    def picture(self, rgb: Image) -> Image:
        """The model's image (h, w, 3) of a frame (H, W, 3)."""
        return self._resample(self._part(rgb))

    def fine_picture(self, rgb: Image) -> Image | None:
        """The same view with k = 2 or 3 times the pixels a side, (k h, k w, 3); None if the frame
        has less than twice the model's pixels per angle."""
        return None if self._resample_finely is None else self._resample_finely(self._part(rgb))

    @cached_property  # its tables take some 30 MB, and only the fit needs them
    def _resample_finely(self) -> Callable[[Image], Image] | None:
        ratio = self._calibration.focal_px / self.camera.focal_px
        times = min(int(ratio + 1e-6), _FINEST)  # rounding may have turned 2 into 1.99...
        return self._resampling(self.camera.enlarged(times))[0] if times > 1 else None

    def _part(self, rgb: Image) -> Image:
        (x, y), part = self._corner, self._calibration
        return rgb[y : y + part.height, x : x + part.width]

    def _resampling(self, target: Camera) -> tuple[Callable[[Image], Image], float]:
        """A function that makes a camera's image of a part, and the share of it that the part
        fills."""
        if self._scaled:
            return partial(resized, width=target.width, height=target.height), 1.0
        resampling = _Resampling(self._calibration, target)
        return resampling, resampling.covered

    def image_px(self, points: Array) -> Array:
        """Pixels (N, 2) of the frame, with its distortion, from pixels (N, 2) of the picture."""
        rays = (points - [self.camera.cx, self.camera.cy]) / self.camera.focal_px
        return self._calibration.image_px(rays) + self._corner

    @property
    def frame_matrix(self) -> Array:
        """The intrinsic matrix (3, 3) of the frame's camera, without its distortion."""
        matrix = self._calibration.matrix.copy()
        matrix[:2, 2] += np.array(self._corner) + 0.5
        return matrix


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
        size = np.array([calibration.width, calibration.height])
        self._frame = np.maximum(np.rint(size / shrink), 1).astype(int).tolist()
        scale_x, scale_y = (self._frame / size).tolist()
        x, y = (x + 0.5) * scale_x - 0.5, (y + 0.5) * scale_y - 0.5
        self._maps = cv2.convertMaps(x, y, cv2.CV_16SC2)
        self._outside, self.covered = ~inside, float(inside.mean())
        self._size = target.width, target.height

    def __call__(self, rgb: Image) -> Image:
        """The target camera's image of a frame (H, W, 3)."""
        shrunk = cv2.resize(rgb, self._frame, interpolation=cv2.INTER_AREA)
        x_y, rest = self._maps
        dense = cv2.remap(shrunk, x_y, rest, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        dense[self._outside] = 0
        return np.asarray(cv2.resize(dense, self._size, interpolation=cv2.INTER_AREA), np.uint8)
