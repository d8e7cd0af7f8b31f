"""Frames, and the interface of what they come from."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Protocol

import cv2
import numpy as np

from shaftpose.core.images import Image


@dataclass(frozen=True)
class Frame:
    """An image to predict.

    source: the name that the user gave: an image file, a video file, a camera or a URL. number:
    position in a video or stream, from 0; 0 for an image file. rgb: (H, W, 3) uint8. fps: frames
    per second of the video or stream; None for an image file.
    """

    source: str
    number: int
    rgb: Image
    fps: float | None = None


def from_bgr(bgr: Any) -> Image:
    """The pixels (H, W, 3) of a frame as `cv2.VideoCapture` reads it."""
    return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), np.uint8)


class Origin(Protocol):
    """Where a frame comes from, as results state it; see `Frame`."""

    @property
    def source(self) -> str:
        """The name that the user gave."""

    @property
    def number(self) -> int:
        """The position in a video or stream."""

    @property
    def fps(self) -> float | None:
        """Frames per second; None for an image file."""


class Source(Protocol):
    """An image file, a video file or a live stream."""

    @property
    def name(self) -> str:
        """The name that the user gave."""

    @property
    def length(self) -> int | None:
        """The number of frames; None if unknown."""

    def frames(self) -> Iterator[Frame]:
        """The frames in their order. Raises InputError naming the source if it cannot be read."""
