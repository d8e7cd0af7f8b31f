"""Whether the frames of a video were decoded at all.

OpenCV since 4.13 reports no failure for interlaced video: it returns memory that it has not
written, with whatever it holds, such as another video's frames.
"""

import os

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.core.errors import InputError

_OTHER_GREY, _COPIES = 85, 8  # what freed memory is made to hold, and how much of it


def opened(name: str) -> cv2.VideoCapture:
    """A video file whose frames are upright: not all versions of OpenCV turn them unasked. Of a
    relative path, what precedes a colon would be taken for a protocol, such as `http:`."""
    capture = cv2.VideoCapture(os.path.abspath(name))
    capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 1)
    return capture


class DecodedFrames:
    """Checks the frames of a video."""

    def __init__(self, name: str) -> None:
        self._name, self._lit, self._checked = name, False, 0
        self._last: NDArray[np.uint8] | None = None

    def check(self, number: int, bgr: NDArray[np.uint8]) -> None:
        """Raise InputError if OpenCV has not written a frame, (H, W, 3). Checks the first frame
        and some that equal the one before them, as all unwritten frames but the first do; each of
        these at twice the last one's number or more, as a check decodes all frames before it."""
        self._lit = self._lit or bool(bgr.any())
        late = number >= 2 * self._checked
        if self._last is None or (late and np.array_equal(self._last, bgr)):
            self._checked = number
            if not self._is_written(number, bgr):
                raise self._unreadable(f"frame {number} cannot be decoded")
        self._last = bgr

    def check_all(self) -> None:
        """Raise InputError if all frames were black."""
        if not self._lit:
            raise self._unreadable("all its frames are black")

    def _is_written(self, number: int, bgr: NDArray[np.uint8]) -> bool:
        """Whether OpenCV decodes the frame to the same picture in memory of other content."""
        again = opened(self._name)
        for _ in range(number + 1):
            again.grab()
        others = [np.full_like(bgr, _OTHER_GREY) for _ in range(_COPIES)]
        del others
        return np.array_equal(again.retrieve()[1], bgr)

    def _unreadable(self, reason: str) -> InputError:
        return InputError(
            f"{self._name}: {reason}; if it is interlaced, install opencv-python-headless 4.12; "
            "or, also if it has 10 bits, convert it: ffmpeg -i OLD -vf yadif -pix_fmt yuv420p NEW"
        )
