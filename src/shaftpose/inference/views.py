"""Views: a model's image of a frame, its camera, and the way back to the frame's pixels.

The paper's networks see squares of a fixed size, networks of any size the whole frame.
"""

from collections.abc import Callable
from functools import lru_cache

import cv2
import numpy as np

from shaftpose.core.errors import InputError, Warn
from shaftpose.core.geometry import Array, Camera
from shaftpose.core.images import Image, resized
from shaftpose.inference.calibration import Calibration
from shaftpose.inference.calibration_files import FrameCamera, stated_view
from shaftpose.inference.fields import Picture

# The fine picture has at most this many times the pixels a side: more cost time and gain little.
_FINEST = 3
_LEAST_COVERED, _CACHED = 0.95, 4  # views, of some MB each
# Of an unknown camera, across its frames' shorter sides: a usual scope's. The wider the angle, the
# more a shaft widens towards its near end.
ASSUMED_VIEW_DEG = 65.0
_LEAST_PX, _LONGEST_ASPECT = 64, 4.0  # of frames that networks of any size see whole
Crop = tuple[int, int, int, int]  # a part of a frame: x, y, width, height in px


class View:
    """Frames of a calibrated camera, resampled for a pinhole camera that looks the same way:
    without distortion, black where the frame ends.

    calibration: of a part of the frames, whose first pixel is `corner`, (x, y). camera: the pinhole
    that sees the model's image. covered: the share of that image that the part fills.
    """

    def __init__(
        self, calibration: Calibration, camera: Camera, corner: tuple[int, int] = (0, 0)
    ) -> None:
        self.calibration, self.camera, self._corner = calibration, camera, corner
        times = min(int(calibration.focal_px / camera.focal_px + 1e-6), _FINEST)
        self._fine = camera.enlarged(max(times, 1))
        x, y, inside = calibration.places_of(self._fine)
        # Against aliasing, the frame is averaged to the density of the fine picture first.
        size = np.array([calibration.width, calibration.height])
        ratio = np.diag(calibration.matrix)[:2] / self._fine.focal_px
        self._frame = np.maximum(np.rint(size / np.maximum(ratio, 1)), 1).astype(int)
        scale_x, scale_y = (self._frame / size).tolist()
        x, y = (x + 0.5) * scale_x - 0.5, (y + 0.5) * scale_y - 0.5
        self._maps = cv2.convertMaps(x, y, cv2.CV_16SC2)
        self._outside, self.covered = ~inside, float(inside.mean())

    def picture(self, rgb: Image) -> Picture:
        """The model's image of a frame (H, W, 3), and the same in 2 or 3 times the pixels a side if
        the frame has as many per angle."""
        (x, y), part, (x_y, rest) = self._corner, self.calibration, self._maps
        shown = rgb[y : y + part.height, x : x + part.width]
        dense = cv2.resize(shown, self._frame, interpolation=cv2.INTER_AREA)
        dense = cv2.remap(dense, x_y, rest, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        dense[self._outside] = 0
        fine = np.asarray(dense, np.uint8)
        small = resized(fine, self.camera.width, self.camera.height)
        return Picture(small, None if self._fine == self.camera else fine, self.camera)

    def image_px(self, points: Array) -> Array:
        """Pixels (N, 2) of the frame, with its distortion, from pixels (N, 2) of the picture."""
        rays = (points - [self.camera.cx, self.camera.cy]) / self.camera.focal_px
        return self.calibration.image_px(rays) + self._corner

    @property
    def frame_matrix(self) -> Array:
        """The intrinsic matrix (3, 3) of the frame's camera, without its distortion."""
        matrix = self.calibration.matrix.copy()
        matrix[:2, 2] += np.array(self._corner) + 0.5
        return matrix


# The view of frames of a width and height, whose pixels have an aspect: width / height.
Views = Callable[[int, int, float], View]


def views(
    camera: FrameCamera | None, model: Camera, frame_px: int | None, crop: Crop | None, warn: Warn
) -> Views:
    """The views of a camera's frames for a model. They raise InputError of frames that do not fit.

    camera: None if it is unknown. model: the camera of the model's training images. frame_px: the
    shorter side of the pictures of whole frames; None: they are what `model` would see. crop: the
    part of all frames to look at, of which `camera` is the camera. warn: gets what is not seen.
    """
    model_deg = 2 * float(np.degrees(np.arctan(model.cx / model.focal_px)))
    camera_of = camera or stated_view(ASSUMED_VIEW_DEG if frame_px else model_deg)

    @lru_cache(maxsize=_CACHED)
    def view(width: int, height: int, aspect: float) -> View:
        x, y, part_width, part_height = crop or (0, 0, width, height)
        option = crop and f"--crop {','.join(map(str, crop))}"
        if min(x, y) < 0 or x + part_width > width or y + part_height > height:
            raise InputError(
                f"has {width} x {height} px, which do not hold {option} (x, y, width, height); "
                "name a part inside the frame"
            )
        try:
            calibration = camera_of(part_width, part_height, aspect)
            seen = View(calibration, _whole(calibration, frame_px) if frame_px else model, (x, y))
        except InputError as error:
            raise InputError(f"{option}: {error}" if option else str(error)) from error
        for cut in calibration.cuts() if frame_px else _square_cuts(seen, camera is not None):
            warn(cut)
        return seen

    return view


def _whole(frames: Calibration, frame_px: int) -> Camera:
    """The camera of whole frames' pictures. Raises InputError if they are too small or too long."""
    undistorted = frames.undistorted(frames.focal_px)
    shorter, longer = sorted((undistorted.width, undistorted.height))
    size = f"{frames.width} x {frames.height} px"
    if min(frames.width, frames.height) < _LEAST_PX:
        raise InputError(f"has {size}; shafts need frames of at least {_LEAST_PX} px a side")
    if longer > _LONGEST_ASPECT * shorter:
        raise InputError(
            f"has {size}, an aspect beyond {_LONGEST_ASPECT:g}:1; name the part to look at by "
            "--crop"
        )
    return frames.undistorted(frames.focal_px * frame_px / shorter)


def _square_cuts(view: View, known: bool) -> list[str]:
    """Sentences about what a model of squares does not see."""
    width, height = view.calibration.width, view.calibration.height
    if not known and width != height:
        return [
            "this model sees squares: of other frames, it looks at the central square alone; name "
            "another part by --crop"
        ]
    if view.covered < _LEAST_COVERED:
        return [
            f"frames of {width} x {height} px fill only {view.covered:.0%} of the view that the "
            "model was trained for; the rest is black, which it has never seen"
        ]
    return []
