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
from shaftpose.inference.film_ends import counts_frames, film_seconds, is_cut
from shaftpose.inference.frames import USUAL_FPS, Frame, from_bgr

_log = logging.getLogger(__name__)
# OpenCV may report the time base of a container or a stream, such as 1,000 or 90,000 per second.
_TIME_BASE = 1000.0
_OBLONGEST = 4.0
_WIDTH, _HEIGHT = cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT
_LEAST_SHARE = 0.9  # of the stated number of frames, or of the film's length


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
        """All frames, at the times that the file states. Raises InputError naming the file if it is
        not a video, ends early, or cannot be decoded; warns if single frames are missing."""
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
        number, time_s, step_s, seen = 0, 0.0, 1 / fps, _SeenFrames(self.name)
        while (bgr := capture.read()[1]) is not None:
            seen.add(np.asarray(bgr, np.uint8))
            last_s, time_s = time_s, _time_s(capture, time_s, fps) if number else 0.0
            step_s = max(step_s, time_s - last_s)
            yield Frame(self.name, number, from_bgr(bgr), time_s, fps, aspect)
            number += 1
        self._check_end(number, time_s + step_s, stated_length(capture) or 0, fps, warn)
        seen.check()

    def _check_end(self, count: int, end_s: float, stated: int, fps: float, warn: Warn) -> None:
        """Raise InputError or warn if frames are missing.

        The stated number may be an estimate from the film's length, or count trimmed frames: then
        its end in time decides, where the last frame may be shown as long as any other.
        """
        stated_s = film_seconds(self.path) or stated / fps
        share = max(count / max(stated, 1), end_s / stated_s if stated_s else 1.0)
        if is_cut(self.path):
            raise InputError(f"{self.path}: is cut short; only its first {count} frames are left")
        if count == 0 or share < _LEAST_SHARE:
            raise InputError(
                f"{self.path}: ends after {count} of {stated} frames; it may be damaged or cut "
                "short"
            )
        if count < stated and end_s < stated_s - 1 / fps and counts_frames(self.path):
            warn(f"{self.path}: {stated - count} of its {stated} frames are missing")


def _time_s(capture: cv2.VideoCapture, last_s: float, fps: float) -> float:
    """The time of a frame after the first, never before `last_s`; some containers state none."""
    time_s = capture.get(cv2.CAP_PROP_POS_MSEC) / 1000
    return max(time_s, last_s) if 0 < time_s < np.inf else last_s + 1 / fps


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
    return fps if 0 < fps < _TIME_BASE else USUAL_FPS
