"""Views: a model's image of a frame, its camera, and the way back to the frame's pixels.

The paper's networks see squares of a fixed size, networks of any size the whole frame.
"""

from collections.abc import Callable
from functools import cache, cached_property, lru_cache, partial
from typing import Protocol

import cv2
import numpy as np

from shaftpose.core.errors import InputError, Warn
from shaftpose.core.geometry import Array, Camera
from shaftpose.core.images import Image, resized
from shaftpose.inference.calibration import Calibration
from shaftpose.inference.calibration_files import FrameCamera

# Samples per pixel and side of frames with more than `_ONE_SAMPLE` times the model's pixels. For
# others, linear interpolation averages enough.
_SAMPLES, _ONE_SAMPLE = 2, 1.5
# The fine picture has at most this many times the pixels a side: more cost time and gain little.
_FINEST = 3
_LEAST_COVERED = 0.95
_CACHED = 4  # views, of some MB each
_SQUARES_ALONE = (
    "this model sees squares: of other frames, it looks at the central square alone; name another "
    "part by --crop"
)
# Of an unknown camera, across its frames' shorter sides: a usual scope's. The wider the angle, the
# more a shaft widens towards its near end.
ASSUMED_VIEW_DEG = 65.0
_LEAST_PX, _LONGEST_ASPECT = 64, 4.0  # of frames that networks of any size see whole


class View(Protocol):
    """A model's image of frames of one size, W x H px.

    camera: the pinhole camera that sees the model's image, w x h px.
    """

    camera: Camera

    def picture(self, rgb: Image) -> Image:
        """The model's image (h, w, 3) of a frame (H, W, 3)."""

    def fine_picture(self, rgb: Image) -> Image | None:
        """The same view with k = 2 or 3 times the pixels a side, (k h, k w, 3); None if the frame
        has less than twice the model's pixels per angle."""

    def image_px(self, points: Array) -> Array:
        """Pixels (N, 2) of the frame from pixels (N, 2) of the model's image."""


# The view of frames of a width and height, in square pixels.
SquareViews = Callable[[int, int], View]
# The same for pixels of any aspect, width / height.
Views = Callable[[int, int, float], View]
# A part of a frame: `x, y, width, height` in px.
Crop = tuple[int, int, int, int]


class Scaled:
    """A frame of width x height px, seen by an unknown camera, scaled to a model's image."""

    def __init__(self, width: int, height: int, camera: Camera) -> None:
        self.camera, self._scale = camera, np.array([width, height]) / [camera.width, camera.height]

    def picture(self, rgb: Image) -> Image:
        """The frame, scaled."""
        return resized(rgb, self.camera.width, self.camera.height)

    def fine_picture(self, rgb: Image) -> Image | None:
        """The frame with more pixels than the model's, if it has them."""
        times = _finer(float(self._scale.min()))
        width, height = times * self.camera.width, times * self.camera.height
        return resized(rgb, width, height) if times > 1 else None

    def image_px(self, points: Array) -> Array:
        """Pixels (N, 2) of the frame from pixels (N, 2) of the picture."""
        return np.asarray(points * self._scale)


def whole_frame(width: int, height: int, side_px: int) -> Scaled:
    """The whole frame, its shorter side scaled to `side_px`, of a camera that sees
    `ASSUMED_VIEW_DEG`.

    Raises InputError if the frame is too small or too long.
    """
    check_frame(width, height)
    size = round(side_px * width / min(width, height)), round(side_px * height / min(width, height))
    focal_px = Camera.from_field_of_view(side_px, side_px, ASSUMED_VIEW_DEG).focal_px
    camera = Camera(*size, focal_px, size[0] / 2, size[1] / 2)
    return Scaled(width, height, camera)


def check_frame(width: int, height: int) -> None:
    """Raise InputError if a network of any size cannot see a frame whole."""
    if min(width, height) < _LEAST_PX:
        raise InputError(
            f"has {width} x {height} px; shafts need frames of at least {_LEAST_PX} px a side"
        )
    if max(width, height) > _LONGEST_ASPECT * min(width, height):
        raise InputError(
            f"has {width} x {height} px, an aspect beyond {_LONGEST_ASPECT:g}:1; name the part to "
            "look at by --crop"
        )


class Resampled:
    """A known camera's frame resampled for a pinhole camera: without distortion, black where the
    frame ends.

    covered: the share of the pinhole's image that the frame fills.
    """

    def __init__(self, calibration: Calibration, camera: Camera) -> None:
        self._calibration, self.camera = calibration, camera
        self._whole = _Resampling(calibration, camera)
        self.covered = self._whole.covered

    def picture(self, rgb: Image) -> Image:
        """The pinhole's image (h, w, 3) of a frame (H, W, 3)."""
        return self._whole(rgb)

    def fine_picture(self, rgb: Image) -> Image | None:
        """The pinhole's image with more pixels, if the frame has them."""
        return None if self._fine is None else self._fine(rgb)

    @cached_property  # its tables take some 30 MB, and only the fit needs them
    def _fine(self) -> "_Resampling | None":
        times = _finer(self._calibration.focal_px / self.camera.focal_px)
        return _Resampling(self._calibration, self.camera.enlarged(times)) if times > 1 else None

    def image_px(self, points: Array) -> Array:
        """Pixels (N, 2) of the distorted frame from pixels (N, 2) of the pinhole's image."""
        centre = np.array([self.camera.cx, self.camera.cy])
        return self._calibration.image_px((points - centre) / self.camera.focal_px)


class Prepared:
    """A view of frames that are first cut or stretched.

    view: of the prepared frames. prepare: prepares a frame. corner, scale: (2,), `x, y`; pixel p of
    a prepared frame is pixel scale p + corner of the frame.
    """

    def __init__(
        self, view: View, prepare: Callable[[Image], Image], corner: Array, scale: Array
    ) -> None:
        self._view, self._prepare, self.camera = view, prepare, view.camera
        self._corner, self._scale = corner, scale

    def picture(self, rgb: Image) -> Image:
        """The model's image of the prepared frame."""
        return self._view.picture(self._prepare(rgb))

    def fine_picture(self, rgb: Image) -> Image | None:
        """The same with more pixels, if the frame has them."""
        return self._view.fine_picture(self._prepare(rgb))

    def image_px(self, points: Array) -> Array:
        """Pixels (N, 2) of the frame from pixels (N, 2) of the model's image."""
        return np.asarray(self._scale * self._view.image_px(points) + self._corner)


def part_of(view: View, part: Crop) -> View:
    """The view of frames of which a part is cut out, from the view of such parts."""
    x, y, width, height = part

    def cut(rgb: Image) -> Image:
        return rgb[y : y + height, x : x + width]

    return Prepared(view, cut, np.array([x, y]), np.ones(2))


def central_square(width: int, height: int, model: Camera) -> View:
    """The central square of an unknown camera's frame, for a model of a fixed size."""
    side = min(width, height)
    square = (width - side) // 2, (height - side) // 2, side, side
    return part_of(Scaled(side, side, model), square)


def square_pixels(views: SquareViews) -> Views:
    """Views of the same frames in square pixels, however the file stores them."""

    def view(width: int, height: int, aspect: float) -> View:
        if aspect == 1:
            return views(width, height)
        wide, high = round(width * max(aspect, 1)), round(height * max(1 / aspect, 1))
        scale = np.array([width / wide, height / high])
        return Prepared(views(wide, high), lambda rgb: resized(rgb, wide, high), np.zeros(2), scale)

    return view


def stored_pixels(views: SquareViews) -> Views:
    """Views of frames as they are stored: their camera knows the aspect of its pixels."""
    return lambda width, height, aspect: views(width, height)


def parts_of(views: Views, part: Crop) -> Views:
    """Views of the same part of all frames; they raise InputError if it is not in the frame."""
    x, y, width, height = part
    option = f"--crop {','.join(map(str, part))}"

    def view(frame_width: int, frame_height: int, aspect: float) -> View:
        if min(x, y) < 0 or x + width > frame_width or y + height > frame_height:
            raise InputError(
                f"has {frame_width} x {frame_height} px, which do not hold {option} "
                "(x, y, width, height); name a part inside the frame"
            )
        try:
            return part_of(views(width, height, aspect), part)
        except InputError as error:
            raise InputError(f"{option}: {error}") from error

    return view


def _finer(ratio: float) -> int:
    """The whole number k of `View.fine_picture`, 1 for none.

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


def unknown_camera(model: Camera, frame_px: int | None, warn: Warn) -> SquareViews:
    """Views of an unknown camera's frames: whole ones, the shorter side scaled to `frame_px`; None:
    their central squares, with a warning of the first frame that is not square."""
    warn_once = cache(partial(warn, _SQUARES_ALONE))

    @lru_cache(maxsize=_CACHED)
    def view(width: int, height: int) -> View:
        if frame_px is not None:
            return whole_frame(width, height, frame_px)
        if width != height:
            warn_once()
        return central_square(width, height, model)

    return view


def known_camera(
    camera: FrameCamera, model: Camera, frame_px: int | None, warn: Warn
) -> SquareViews:
    """Views of a known camera's frames: undistorted, the shorter side scaled to `frame_px`; None:
    resampled for the model's camera.

    They warn of what is not seen.
    """

    @lru_cache(maxsize=_CACHED)
    def view(width: int, height: int) -> View:
        calibration = camera(width, height)
        if frame_px is not None:
            check_frame(width, height)
            for cut in calibration.cuts():
                warn(cut)
            whole = calibration.undistorted(calibration.focal_px)
            focal_px = whole.focal_px * frame_px / min(whole.width, whole.height)
            return Resampled(calibration, calibration.undistorted(focal_px))
        resampled = Resampled(calibration, model)
        if resampled.covered < _LEAST_COVERED:
            warn(
                f"frames of {width} x {height} px fill only {resampled.covered:.0%} of the view "
                "that the model was trained for; the rest is black, which it has never seen"
            )
        return resampled

    return view
