"""The choice of the picture that a model sees of a user's frames.

The paper's networks see squares of a fixed size, networks of any size the whole frame.
"""

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from shaftpose.core.errors import InputError, Warn
from shaftpose.core.geometry import Camera
from shaftpose.inference.calibration import Calibration
from shaftpose.inference.calibration_files import FrameCamera
from shaftpose.inference.views import View

# Of an unknown camera, across its frames' shorter sides: a usual scope's. The wider the angle, the
# more a shaft widens towards its near end.
ASSUMED_VIEW_DEG = 65.0
_LEAST_PX, _LONGEST_ASPECT = 64, 4.0  # of frames that networks of any size see whole
_LEAST_COVERED = 0.95
_TWO_PICTURES = 2.45  # aspect: no usual screen is as wide; two pictures of 5:4 or 4:3 are
_CACHED = 4  # views, of up to some tens of MB each
_SQUARES_ALONE = (
    "this model sees squares: of other frames, it looks at the central square alone; name another "
    "part by --crop"
)

Crop = tuple[int, int, int, int]  # a part of a frame: x, y, width, height in px
# The view of frames, by their width, height and the aspect of their pixels, width / height.
Views = Callable[[int, int, float], View]


def views(
    camera: FrameCamera | None, model: Camera, frame_px: int | None, crop: Crop | None, warn: Warn
) -> Views:
    """The views of a camera's frames. They raise InputError of frames that do not fit.

    camera: None if it is unknown. model: the camera of the model's training images. frame_px: the
    shorter side of pictures of whole frames; None: the model sees squares, by its own camera. crop:
    the part of all frames to look at, of which `camera` is the camera. warn: gets what is not seen
    of frames of each size, and a hint if they may be two pictures.
    """

    @lru_cache(maxsize=_CACHED)
    def view(width: int, height: int, aspect: float) -> View:
        if crop is None:
            whole = _view(camera, model, frame_px, (0, 0, width, height), aspect, warn)
            pixel = aspect if camera is None else camera(width, height, aspect).aspect
            if pixel * width >= _TWO_PICTURES * height:
                warn(
                    f"frames of {width} x {height} px are as wide as two pictures: if they are the "
                    "two eyes of a stereo camera, choose one by --crop"
                )
            return whole
        x, y, part_width, part_height = crop
        option = f"--crop {x},{y},{part_width},{part_height}"
        if min(x, y) < 0 or x + part_width > width or y + part_height > height:
            raise InputError(
                f"has {width} x {height} px, which do not hold {option} (x, y, width, height); "
                "name a part inside the frame"
            )
        try:
            return _view(camera, model, frame_px, crop, aspect, warn)
        except InputError as error:
            raise InputError(f"{option}: {error}") from error

    return view


def _view(
    camera: FrameCamera | None,
    model: Camera,
    frame_px: int | None,
    part: Crop,
    aspect: float,
    warn: Warn,
) -> View:
    """The view of a part of frames."""
    x, y, width, height = part
    if camera is None:
        return _of_unknown_camera(model, frame_px, part, aspect, warn)
    calibration = camera(width, height, aspect)
    if frame_px is not None:
        _check_whole(width, height, calibration.aspect)
        for cut in calibration.cuts():
            warn(cut)
        return View(calibration, _undistorted(calibration, frame_px), (x, y))
    view = View(calibration, model, (x, y))
    if view.covered < _LEAST_COVERED:
        warn(
            f"frames of {width} x {height} px fill only {view.covered:.0%} of the view that the "
            "model was trained for; the rest is black, which it has never seen"
        )
    return view


def _of_unknown_camera(
    model: Camera, frame_px: int | None, part: Crop, aspect: float, warn: Warn
) -> View:
    """The view of an unknown camera's frames: scaled, for a model of squares their central square,
    as if its camera were the model's."""
    x, y, width, height = part
    if frame_px is None:
        side = min(aspect * width, height)  # in heights of a pixel
        wide, high = round(side / aspect), round(side)
        if max(width - wide, height - high) > 0:
            warn(_SQUARES_ALONE)
        corner = x + (width - wide) // 2, y + (height - high) // 2
        return View(Calibration.scaled(model, wide, high), model, corner, scaled=True)
    _check_whole(width, height, aspect)
    sides = np.array([aspect * width, height])
    wide, high = np.rint(frame_px * sides / sides.min()).astype(int).tolist()
    focal_px = Camera.from_field_of_view(frame_px, frame_px, ASSUMED_VIEW_DEG).focal_px
    seen_by = Camera(wide, high, focal_px, wide / 2, high / 2)
    return View(Calibration.scaled(seen_by, width, height), seen_by, (x, y), scaled=True)


def _undistorted(calibration: Calibration, frame_px: int) -> Camera:
    """The pinhole of whole frames whose image has a shorter side of `frame_px`."""
    whole = calibration.undistorted(calibration.focal_px)
    return calibration.undistorted(calibration.focal_px * frame_px / min(whole.width, whole.height))


def _check_whole(width: int, height: int, aspect: float) -> None:
    """Raise InputError if a network of any size cannot see frames whole. aspect: of a pixel."""
    if min(width, height) < _LEAST_PX:
        raise InputError(
            f"has {width} x {height} px; shafts need frames of at least {_LEAST_PX} px a side"
        )
    shorter, longer = sorted((round(aspect * width), height))
    if longer > _LONGEST_ASPECT * shorter:
        raise InputError(
            f"has {width} x {height} px, an aspect beyond {_LONGEST_ASPECT:g}:1; name a shorter "
            "part by --crop"
        )
