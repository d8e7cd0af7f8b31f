"""Cameras and streams as sources of frames. A slow prediction skips frames."""

import logging
from collections.abc import Iterator
from dataclasses import dataclass
from threading import Condition, Thread
from time import monotonic
from typing import Any, Protocol

import cv2

from shaftpose.core.errors import InputError, Warn
from shaftpose.frame_sources.frames import Frame, from_bgr
from shaftpose.frame_sources.video_files import frame_rate, opencv_takes, pixel_aspect

_log = logging.getLogger(__name__)
_PATIENCE_S = 2.0  # for a blocking read when the stream is closed


class Capture(Protocol):
    """The part of `cv2.VideoCapture` that reading needs."""

    def read(self) -> tuple[bool, Any]:
        """Wait for the next frame: whether there is one, and its pixels."""

    def release(self) -> None:
        """Close the device."""


Numbered = tuple[int, float, Any]


class NewestFrames:
    """Reads a capture in a thread and keeps only its newest frame: memory does not grow, and a slow
    reader never lags behind.

    Iterating yields the number of each frame, from 0, its time in s since the first, and its pixels
    as the capture gives them, until the capture ends. The thread releases the capture.
    """

    def __init__(self, capture: Capture) -> None:
        self._capture, self._changed = capture, Condition()
        self._newest: Numbered | None = None
        self._ended = False
        self._thread = Thread(target=self._read, daemon=True)
        self._thread.start()

    def __iter__(self) -> Iterator[Numbered]:
        while (newest := self._next()) is not None:
            yield newest

    def close(self) -> None:
        """Stop reading."""
        self._ended = True
        self._thread.join(_PATIENCE_S)

    def _next(self) -> Numbered | None:
        with self._changed:
            self._changed.wait_for(lambda: self._ended or self._newest is not None)
            newest, self._newest = self._newest, None
            return newest

    def _read(self) -> None:
        number, start_s = 0, 0.0
        try:
            while not self._ended:
                there, pixels = self._capture.read()
                if not there:
                    break
                start_s = start_s or monotonic()
                self._put((number, monotonic() - start_s, pixels))
                number += 1
        finally:
            with self._changed:
                self._ended = True
                self._changed.notify()
            self._capture.release()

    def _put(self, frame: Numbered) -> None:
        with self._changed:
            self._newest = frame
            self._changed.notify()


@dataclass(frozen=True)
class LiveStream:
    """A camera, by its index, or a stream, by its URL: a `Source` of the newest frames.

    The numbers of frames count skipped ones, too.
    """

    address: int | str
    length: None = None

    def frames(self, warn: Warn = _log.warning) -> Iterator[Frame]:
        """Frames until Ctrl-C. Raises InputError naming the source if it cannot be opened, or ends:
        its connection is lost."""
        address = self.address
        if isinstance(address, str) and not opencv_takes(address):
            raise InputError(f"{address}: a stream's address must be UTF-8; write %XX for others")
        # Two overloads of VideoCapture, by index and by name.
        capture = (
            cv2.VideoCapture(address) if isinstance(address, int) else cv2.VideoCapture(address)
        )
        if not capture.isOpened():
            raise InputError(f"{self.name}: cannot be opened; is it there, and used by no other?")
        aspect = pixel_aspect(self.name, capture)
        fps, newest = frame_rate(capture), NewestFrames(capture)
        try:
            for number, time_s, bgr in newest:
                yield Frame(self.name, number, from_bgr(bgr), time_s, fps, aspect)
        finally:
            newest.close()
        raise InputError(f"{self.name}: shows no more frames; is it still connected?")

    @property
    def name(self) -> str:
        """`camera` and its index, or the URL."""
        return f"camera {self.address}" if isinstance(self.address, int) else self.address
