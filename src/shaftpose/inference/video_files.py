"""Video files as a source of frames."""

import logging
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose import MOST_PIXELS
from shaftpose.core.errors import InputError, Warn
from shaftpose.inference.frames import Frame, from_bgr

_log = logging.getLogger(__name__)
_USUAL_FPS = 25.0  # assumed if a file or a device states none
# OpenCV may report the time base of a container or a stream, such as 1,000 or 90,000 per second.
_LEAST_FPS, _MOST_FPS = 1.0, 240.0
_OBLONGEST = 4.0
_WIDTH, _HEIGHT = cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT
_LEAST_SHARE = 0.9  # of the header's number of frames, which may be an estimate


@dataclass(frozen=True)
class VideoFile:
    """A video: a `Source` of all its frames."""

    path: Path

    @property
    def name(self) -> str:
        """The path."""
        return str(self.path)

    @property
    def length(self) -> int | None:
        """The number of frames that the header states; None if it states none."""
        return stated_length(cv2.VideoCapture(self.name)) if opencv_takes(self.name) else None

    def frames(self, warn: Warn = _log.warning) -> Iterator[Frame]:
        """All frames. Raises InputError naming the file if it is not a video or ends early."""
        if not os.path.isfile(self.path):
            raise InputError(
                f"{self.path}: no such file; name an image, a folder, a video, or a camera by its "
                "number"
            )
        if not opencv_takes(self.name):
            raise InputError(f"{self.path}: a video's name must be UTF-8; rename it")
        capture = _opened(self.name)
        if not capture.isOpened():
            raise InputError(f"{self.path}: neither an image nor a video that OpenCV can read")
        check_size(self.name, capture)
        fps, aspect = frame_rate(capture), pixel_aspect(self.name, capture)
        stated, number, seen = stated_length(capture) or 0, 0, _SeenFrames(self.name)
        while (bgr := capture.read()[1]) is not None:
            seen.add(np.asarray(bgr, np.uint8))
            yield Frame(self.name, number, from_bgr(bgr), fps, aspect)
            number += 1
        if number == 0 or number < _LEAST_SHARE * stated:
            raise InputError(
                f"{self.path}: ends after {number} of {stated} frames; it may be damaged or cut "
                "short"
            )
        seen.check()


class _SeenFrames:
    """Whether the frames of a video were decoded at all. OpenCV since 4.13 reports no failure for
    interlaced video: it returns memory that it has not written, with whatever it holds."""

    def __init__(self, name: str) -> None:
        self._name, self._count, self._lit, self._repeats = name, 0, False, False
        self._last: NDArray[np.uint8] | None = None

    def add(self, bgr: NDArray[np.uint8]) -> None:
        """Add the next frame. Raises InputError if OpenCV has not written it; of later frames, only
        the first that repeats the one before it can be such a one."""
        self._lit = self._lit or bool(bgr.any())
        first = self._last is None
        repeats = self._repeats or (self._last is not None and np.array_equal(self._last, bgr))
        if (first or repeats > self._repeats) and not self._is_written(bgr):
            raise self._unreadable(f"frame {self._count} cannot be decoded")
        self._last, self._count, self._repeats = bgr, self._count + 1, repeats

    def check(self) -> None:
        """Raise InputError if all frames are black."""
        if not self._lit:
            raise self._unreadable("all its frames are black")

    def _is_written(self, bgr: NDArray[np.uint8]) -> bool:
        """Whether OpenCV decodes the frame to the same picture in memory of other content."""
        again = _opened(self._name)
        for _ in range(self._count + 1):
            again.grab()
        others = [np.full_like(bgr, 85) for _ in range(8)]
        del others
        return np.array_equal(again.retrieve()[1], bgr)

    def _unreadable(self, reason: str) -> InputError:
        return InputError(
            f"{self._name}: {reason}; if it is interlaced, install opencv-python-headless 4.12 or "
            "convert it, as by ffmpeg -i OLD -vf yadif NEW"
        )


def _opened(name: str) -> cv2.VideoCapture:
    """A video whose frames are upright: not all versions of OpenCV turn them unasked."""
    capture = cv2.VideoCapture(name)
    capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 1)
    return capture


def check_size(name: str, capture: cv2.VideoCapture) -> None:
    """Raise InputError naming a video that states more pixels than images may have."""
    width, height = (int(capture.get(side)) for side in (_WIDTH, _HEIGHT))
    if width * height > int(os.environ[MOST_PIXELS]):
        raise InputError(
            f"{name}: has frames of {width} x {height} px; scale it down, or set {MOST_PIXELS}"
        )


def pixel_aspect(name: str, capture: cv2.VideoCapture) -> float:
    """The width / height of a pixel of a video's frames, 1 if it states none.

    Raises InputError naming the video if it states a meaningless one.
    """
    width, height = capture.get(cv2.CAP_PROP_SAR_NUM), capture.get(cv2.CAP_PROP_SAR_DEN)
    if not (width > 0 and height > 0):
        return 1.0
    if not 1 / _OBLONGEST <= width / height <= _OBLONGEST:
        raise InputError(f"{name}: states pixels of {width:g} : {height:g}; convert it")
    turned = int(capture.get(cv2.CAP_PROP_ORIENTATION_META)) % 180 == 90  # OpenCV turns frames back
    return height / width if turned else width / height


def opencv_takes(name: str) -> bool:
    """Whether a name is UTF-8. Others crash the process inside OpenCV's video functions."""
    try:
        name.encode()
    except UnicodeEncodeError:
        return False
    return True


def stated_length(capture: cv2.VideoCapture) -> int | None:
    """The number of frames that a video's header states; None if it states none."""
    count = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
    return count if count > 0 else None


def frame_rate(capture: cv2.VideoCapture) -> float:
    """Frames per second of a video or device; a usual value if it states none."""
    fps = float(capture.get(cv2.CAP_PROP_FPS))
    return fps if _LEAST_FPS <= fps <= _MOST_FPS else _USUAL_FPS
