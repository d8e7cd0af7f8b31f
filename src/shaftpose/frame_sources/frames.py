"""Frames, their sources, and image files as the simplest source."""

import logging
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np

from shaftpose.core.errors import InputError, Warn
from shaftpose.core.images import Image
from shaftpose.image_files.reading import is_image, read_rgb

# Files that are named like this are films, or pictures that OpenCV reads as films.
_FILMS = frozenset(
    (".avi", ".gif", ".m4v", ".mkv", ".mov", ".mp4", ".mpeg", ".mpg", ".ts", ".webm", ".wmv")
)
USUAL_FPS = 25.0  # assumed where none is stated
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Frame:
    """An input image.

    source: the name that the user gave: an image file, a video file, a camera or a URL. number:
    position in a video or stream, from 0; 0 for an image file. rgb: (H, W, 3) uint8. time_s: since
    the first frame; None for an image file. fps: nominal frames per second of the video or stream.
    aspect: of a pixel, width / height.
    """

    source: str
    number: int
    rgb: Image
    time_s: float | None = None
    fps: float = USUAL_FPS
    aspect: float = 1.0


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
    def time_s(self) -> float | None:
        """The time since the first frame; None for an image file."""


class Source(Protocol):
    """An image file, a video file or a live stream."""

    @property
    def name(self) -> str:
        """The name that the user gave."""

    @property
    def length(self) -> int | None:
        """The number of frames; None if unknown."""

    def frames(self, warn: Warn) -> Iterator[Frame]:
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

    def frames(self, warn: Warn = _log.warning) -> Iterator[Frame]:
        """The image. Raises InputError naming the file if it is missing or is not an image."""
        yield Frame(self.name, 0, read_rgb(self.path, warn))


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

    def frames(self, warn: Warn = _log.warning) -> Iterator[Frame]:
        """Raises InputError naming the folder."""
        raise InputError(f"{self.path}: {self.reason}; name a folder of images")


def images_of(folder: Path, warn: Warn = _log.warning) -> Sequence[ImageFile | EmptyFolder]:
    """The images in a folder, sorted by name, numbers in names by value. Subfolders, hidden files
    and unfinished copies (`.part`) are ignored. warn: is told of films."""
    try:
        named = [path for path in folder.iterdir() if _is_candidate(path)]
    except OSError as error:
        return [EmptyFolder(folder, f"cannot be read ({error.strerror})")]
    files = sorted(filter(is_image, named), key=_numbers_by_value)
    films = {path.name for path in named if path.suffix.lower() in _FILMS}
    if films := films - {path.name for path in files}:
        warn(
            f"{folder}: its films are left out ({len(films)}, such as {min(films)}); name each film"
        )
    return [ImageFile(path) for path in files] or [EmptyFolder(folder, "holds no image")]


def _is_candidate(path: Path) -> bool:
    hidden = path.name.startswith(".") or path.name.endswith(".part")
    return not hidden and not os.path.isdir(path)  # never raises, as for links into closed folders


def _numbers_by_value(path: Path) -> tuple[list[str | int], str]:
    """A key that sorts f2 before f10. Texts and numbers take turns in the list."""
    parts = re.split(r"(\d+)", path.name)
    return [int(part) if n % 2 else part for n, part in enumerate(parts)], path.name
