"""Video files as a source of frames."""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2

from shaftpose.core.errors import InputError
from shaftpose.inference.frames import Frame, from_bgr

_USUAL_FPS = 25.0  # assumed if a file or a device states none
# OpenCV may report the time base of a container or a stream, such as 1,000 or 90,000 per second.
_LEAST_FPS, _MOST_FPS = 1.0, 240.0
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

    def frames(self) -> Iterator[Frame]:
        """All frames. Raises InputError naming the file if it is not a video or ends early."""
        if not os.path.isfile(self.path):
            raise InputError(
                f"{self.path}: no such file; name an image, a folder, a video, or a camera by its "
                "number"
            )
        if not opencv_takes(self.name):
            raise InputError(f"{self.path}: a video's name must be UTF-8; rename it")
        capture = cv2.VideoCapture(self.name)
        if not capture.isOpened():
            raise InputError(f"{self.path}: neither an image nor a video that OpenCV can read")
        fps, stated, number = frame_rate(capture), stated_length(capture) or 0, 0
        while (frame := capture.read()[1]) is not None:
            yield Frame(self.name, number, from_bgr(frame), fps)
            number += 1
        if number == 0 or number < _LEAST_SHARE * stated:
            raise InputError(
                f"{self.path}: ends after {number} of {stated} frames; it may be damaged or cut "
                "short"
            )


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
