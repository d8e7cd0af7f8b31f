"""Frames, their sources, and image files as the simplest source."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np

from shaftpose.core.errors import InputError
from shaftpose.core.images import Image, read_rgb

_SUFFIXES = frozenset((".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp"))


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


class FrameId(Protocol):
    """The part of a `Frame` that results state."""

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
        """The frames in order. Raises InputError naming the source if it cannot be read."""


@dataclass(frozen=True)
class ImageFile:
    """A file with one image: a `Source` of one frame."""

    path: Path
    length: int = 1

    @property
    def name(self) -> str:
        """The path."""
        return str(self.path)

    def frames(self) -> Iterator[Frame]:
        """The image. Raises InputError naming the file if it is missing or is not an image."""
        yield Frame(self.name, 0, read_rgb(self.path))


def is_image(path: Path) -> bool:
    """Whether the suffix of a file is that of an image."""
    return path.suffix.lower() in _SUFFIXES


@dataclass(frozen=True)
class EmptyFolder:
    """A folder without images: a `Source` without frames, which raises its error in its turn."""

    path: Path
    reason: str
    length: int = 0

    @property
    def name(self) -> str:
        """The path."""
        return str(self.path)

    def frames(self) -> Iterator[Frame]:
        """Raises InputError naming the folder."""
        raise InputError(
            f"{self.path}: {self.reason}; images end in {', '.join(sorted(_SUFFIXES))}"
        )


def images_of(folder: Path) -> Sequence[ImageFile | EmptyFolder]:
    """The images in a folder, sorted by name; subfolders are ignored."""
    try:
        files = sorted(path for path in folder.iterdir() if is_image(path))
    except OSError as error:
        return [EmptyFolder(folder, f"cannot be read ({error.strerror})")]
    return [ImageFile(path) for path in files] or [EmptyFolder(folder, "holds no image")]
