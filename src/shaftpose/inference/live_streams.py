"""Cameras and streams as sources of frames. A slow prediction skips frames."""

import logging
from collections.abc import Iterator
from dataclasses import dataclass
from threading import Condition, Thread
from typing import Any, Protocol

import cv2

from shaftpose.core.errors import InputError, Warn
from shaftpose.inference.frames import Frame, from_bgr
from shaftpose.inference.video_files import frame_rate, opencv_takes

_log = logging.getLogger(__name__)
_PATIENCE_S = 2.0  # for a blocking read when the stream is closed


class Capture(Protocol):
    """The part of `cv2.VideoCapture` that reading needs."""

    def read(self) -> tuple[bool, Any]:
        """Wait for the next frame: whether there is one, and its pixels."""

    def release(self) -> None:
        """Close the device."""


class NewestFrames:
    """Reads a capture in a thread and keeps only its newest frame: memory does not grow, and a slow
    reader never lags behind.

    Iterating yields the number of each frame, from 0, and its pixels as the capture gives them,
    until the capture ends. The thread releases the capture.
    """

    def __init__(self, capture: Capture) -> None:
        self._capture, self._changed = capture, Condition()
        self._newest: tuple[int, Any] | None = None
        self._ended = False
        self._thread = Thread(target=self._read, daemon=True)
        self._thread.start()

    def __iter__(self) -> Iterator[tuple[int, Any]]:
        while (newest := self._next()) is not None:
            yield newest

    def close(self) -> None:
        """Stop reading."""
        self._ended = True
        self._thread.join(_PATIENCE_S)

    def _next(self) -> tuple[int, Any] | None:
        with self._changed:
            self._changed.wait_for(lambda: self._ended or self._newest is not None)
            newest, self._newest = self._newest, None
            return newest

    def _read(self) -> None:
        number = 0
        try:
            while not self._ended:
                there, pixels = self._capture.read()
                if not there:
                    break
                self._put(number, pixels)
                number += 1
        finally:
            with self._changed:
                self._ended = True
                self._changed.notify()
            self._capture.release()

    def _put(self, number: int, pixels: Any) -> None:
        with self._changed:
            self._newest = number, pixels
            self._changed.notify()


@dataclass(frozen=True)
class LiveStream:
    """A camera, by its index, or a stream, by its URL: a `Source` of the newest frames.

    The numbers of frames count skipped ones, too.
    """

    address: int | str
    length: None = None

    def frames(self, warn: Warn = _log.warning) -> Iterator[Frame]:
        """Frames until the stream ends.

        Raises InputError naming the source if it gives no frame, or if it is a camera and ends: its
        connection is lost.
        """
        address = self.address
        if isinstance(address, str) and not opencv_takes(address):
            raise InputError(f"{address}: a stream's address must be UTF-8; write %XX for others")
        # Two overloads of VideoCapture, by index and by name.
        capture = (
            cv2.VideoCapture(address) if isinstance(address, int) else cv2.VideoCapture(address)
        )
        if not capture.isOpened():
            raise InputError(f"{self.name}: cannot be opened; is it there, and used by no other?")
        fps, newest, number = frame_rate(capture), NewestFrames(capture), -1
        try:
            for number, bgr in newest:
                yield Frame(self.name, number, from_bgr(bgr), fps)
        finally:
            newest.close()
        if number < 0 or isinstance(address, int):
            raise InputError(f"{self.name}: shows no more frames; is it still connected?")

    @property
    def name(self) -> str:
        """`camera` and its index, or the URL."""
        return f"camera {self.address}" if isinstance(self.address, int) else self.address
