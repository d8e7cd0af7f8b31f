"""Video files as a source of frames."""

import logging
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from shaftpose import MOST_PIXELS
from shaftpose.core.errors import InputError, Warn
from shaftpose.frame_sources.decoded_frames import DecodedFrames, opened
from shaftpose.frame_sources.film_clock import FilmClock
from shaftpose.frame_sources.film_ends import (
    counts_frames,
    counts_from_zero,
    film_seconds,
    is_cut,
    is_mirrored,
    video_tracks,
)
from shaftpose.frame_sources.film_gaps import FilmGaps
from shaftpose.frame_sources.frames import USUAL_FPS, Frame, from_bgr
from shaftpose.image_files.reading import most_pixels

_log = logging.getLogger(__name__)
# OpenCV may report the time base of a container or a stream, such as 1,000 or 90,000 per second.
_TIME_BASE = 1000.0
_OBLONGEST = 4.0
_WIDTH, _HEIGHT = cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT
_LEAST_SHARE = 0.9  # of the stated number of frames, or of the film's length


@dataclass(frozen=True)
class Span:
    """The frames of a film that are wanted: each `every`-th, from start to end in s."""

    start_s: float = 0.0
    end_s: float = np.inf
    every: int = 1


@dataclass(frozen=True)
class VideoFile:
    """A video: a `Source` of its frames.

    first: the number of the first one that is wanted.
    """

    path: Path
    span: Span = Span()
    first: int = 0

    @property
    def name(self) -> str:
        """The path."""
        return str(self.path)

    @property
    def length(self) -> int | None:
        """The number of frames that the header states; None if it states none, or not all frames
        are wanted."""
        readable = os.path.isfile(self.path) and opencv_takes(self.name)
        if not readable or self.span != Span():
            return None
        return stated_length(opened(self.name))

    def frames(self, warn: Warn = _log.warning) -> Iterator[Frame]:
        """The frames, at the times that the file states. Raises InputError naming the file if it is
        not a video, ends early, or cannot be decoded; warns if single frames are missing."""
        capture = self._opened()
        if (tracks := video_tracks(self.path)) > 1:
            warn(f"{self.path}: holds {tracks} videos; the first one is used")
        fps, aspect = frame_rate(capture), pixel_aspect(self.name, capture)
        number, time_s, step_s, stated = 0, 0.0, 1 / fps, 0
        decoded, gaps, clock = DecodedFrames(self.name), FilmGaps(fps), FilmClock(fps)
        while capture.grab():
            stated_s = capture.get(cv2.CAP_PROP_POS_MSEC) / 1000
            last_s, time_s = time_s, clock.time_s(stated_s) if number else 0.0
            step_s = max(step_s, time_s - last_s)
            if time_s >= self.span.end_s:
                self._check_gaps(gaps, warn)
                return
            if number:
                gaps.add(time_s)
            else:
                stated = self._stated(capture)
            if number == 0 or self._wants(number, time_s):
                bgr = capture.retrieve()[1]
                if bgr is None:  # a damaged file
                    break
                decoded.check(number, np.asarray(bgr, np.uint8))
                if self._wants(number, time_s):
                    rate = fps / self.span.every
                    yield Frame(self.name, number, from_bgr(bgr), time_s, rate, aspect)
            number += 1
        self._check_end(number, time_s + step_s, stated, fps, warn)
        self._check_gaps(gaps, warn)
        if self.first == 0 and self.span == Span():
            decoded.check_all()

    def _opened(self) -> cv2.VideoCapture:
        if not os.path.isfile(self.path):
            reason = "a pipe or a device" if os.path.exists(self.path) else "no such file"
            raise InputError(
                f"{self.path}: {reason}; name an image, a folder, a video, or a camera's number"
            )
        if not opencv_takes(self.name):
            raise InputError(f"{self.path}: a video's name must be UTF-8; rename it")
        capture = opened(self.name)
        if not capture.isOpened():
            if os.path.getsize(self.path) == 0:
                raise InputError(f"{self.path}: an empty file; copy it again")
            raise InputError(
                f"{self.path}: neither an image nor a video that OpenCV can read; if it shows "
                "frames, as DICOM files do, convert it to PNG, JPEG or MP4"
            )
        if is_mirrored(self.path):
            raise InputError(
                f"{self.path}: asks for a mirrored picture; convert it: ffmpeg -i OLD NEW.mp4"
            )
        check_size(self.name, capture)
        return capture

    def _stated(self, capture: cv2.VideoCapture) -> int:
        """The number of frames that the header states, from the first one on, which was grabbed;
        0 if it states none."""
        count = stated_length(capture) or 0
        if counts_from_zero(self.path):
            count -= max(int(capture.get(cv2.CAP_PROP_PTS)), 0)
        return max(count, 0)

    def _wants(self, number: int, time_s: float) -> bool:
        timely = time_s >= self.span.start_s and number % self.span.every == 0
        return timely and number >= self.first

    def _check_end(self, count: int, end_s: float, stated: int, fps: float, warn: Warn) -> None:
        """Raise InputError or warn if frames are missing.

        The stated number may be an estimate from the film's length, or include trimmed frames:
        then the end time decides; the last frame may last as long as the longest.
        """
        stated_s = film_seconds(self.path) or stated / fps
        share = max(count / max(stated, 1), end_s / stated_s if stated_s else 1.0)
        if is_cut(self.path):
            raise InputError(f"{self.path}: is cut short; only its first {count} frames are left")
        if count == 0:
            raise InputError(
                f"{self.path}: OpenCV cannot decode its frames; convert it: ffmpeg -i OLD "
                "-pix_fmt yuv420p NEW.mp4"
            )
        if share < _LEAST_SHARE:
            raise InputError(
                f"{self.path}: ends after {count} of {stated} frames; it may be damaged or cut "
                "short, or its sound last longer"
            )
        if count < stated and end_s < stated_s - 1 / fps and counts_frames(self.path):
            warn(f"{self.path}: {stated - count} of its {stated} frames are missing")
        if end_s <= self.span.start_s:
            raise InputError(f"{self.path}: ends after {end_s:.2f} s, before --start")

    def _check_gaps(self, gaps: FilmGaps, warn: Warn) -> None:
        """Warn of gaps in a film that does not state its exact number of frames."""
        if str(gaps) and not counts_frames(self.path):
            warn(f"{self.path}: {gaps}; it may be damaged there")


def check_size(name: str, capture: cv2.VideoCapture) -> None:
    """Raise InputError naming a video that states more pixels than images may have."""
    width, height = (int(capture.get(side)) for side in (_WIDTH, _HEIGHT))
    if width * height > most_pixels():
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
