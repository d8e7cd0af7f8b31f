"""Reading the image files of others: (H, W, 3) uint8 RGB."""

import logging
import os
import re
import stat
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose import MOST_PIXELS
from shaftpose.core.errors import InputError, Warn
from shaftpose.core.images import Image
from shaftpose.image_files.formats import (
    HEAD_BYTES,
    has_image_head,
    orientation,
    picture_count,
    still,
)
from shaftpose.image_files.oddities import greatest_value, misread, oblong, overruns

_MOST_BYTES = 2**30  # of an image file, which is read as a whole
# Files that are named like this are images even if their content is damaged.
_SUFFIXES = frozenset((".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp"))
_log = logging.getLogger(__name__)


def most_pixels() -> int:
    """The most pixels that an image may have, as OpenCV reads it from the environment."""
    number, unit = re.split("(?![0-9])", os.environ[MOST_PIXELS], maxsplit=1)
    return int(number) * {"": 1, "kb": 2**10, "mb": 2**20}[unit.lower()]


def is_image(path: Path) -> bool:
    """Whether a file is an image by its content or, if that is unknown, by its name."""
    return has_image_head(_head(path)) or path.suffix.lower() in _SUFFIXES


def _head(path: Path) -> bytes:
    """The first bytes of a file; of a pipe, a device or an unreadable file none."""
    try:
        if not path.is_file():
            return b""
        with path.open("rb") as file:
            return file.read(HEAD_BYTES)
    except (OSError, ValueError):  # a name that holds a NUL is a ValueError
        return b""


def read_rgb(path: Path, warn: Warn = _log.warning) -> Image:
    """The first picture in an image file, turned as EXIF says, of 8 bits.

    warn: is told of further pictures, of pixels that are not square, and of 16 bits that are not
    all used. Raises InputError naming the file if it is missing, unreadable, too large or not an
    image, or if OpenCV misreads it.
    """
    data = _content(path)
    turned = orientation(data)
    pixels = _decoded(path, data, turned is not None)
    if not np.issubdtype(pixels.dtype, np.integer):
        raise InputError(f"{path}: its pixels are decimal numbers; save them as 8 or 16 bits")
    if (count := picture_count(data)) > 1:
        warn(f"{path}: holds {count} pictures; all but the first are left out, {count - 1}")
    if sides := oblong(data):
        warn(
            f"{path}: states pixels that are not square ({sides[0]} : {sides[1]}); they are taken "
            "for square: if they are not, resize it"
        )
    bgr = _upright(_eight_bits(pixels, greatest_value(data), warn), turned or 1)
    return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), np.uint8)


def _decoded(path: Path, data: bytes, as_stored: bool) -> NDArray[Any]:
    """The pixels (H, W, 3), blue first. as_stored: not turned as EXIF says."""
    if reason := misread(data):
        raise InputError(f"{path}: {reason}; save it as a PNG of 8 or 16 bits")
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH
    if as_stored:
        flags |= cv2.IMREAD_IGNORE_ORIENTATION
    whole = bool(data) and not overruns(data)
    try:
        pixels = cv2.imdecode(np.frombuffer(still(data), np.uint8), flags) if whole else None
    except cv2.error as error:  # it refuses the size
        raise InputError(
            f"{path}: states a size beyond {os.environ[MOST_PIXELS]} pixels; scale it down, or set "
            f"{MOST_PIXELS}"
        ) from error
    if pixels is None:
        raise InputError(f"{path}: not a readable image; replace it with an intact PNG or JPEG")
    return np.asarray(pixels)


def _content(path: Path) -> bytes:
    """The bytes of a regular file: pipes wait and devices never end."""
    try:
        status = path.stat()
        if stat.S_ISREG(status.st_mode) and status.st_size <= _MOST_BYTES:
            return path.read_bytes()
    except (OSError, ValueError) as error:  # a name that holds a NUL is a ValueError
        reason = error.strerror if isinstance(error, OSError) else error
        raise InputError(
            f"{path}: cannot be read ({reason}); name a readable image file"
        ) from error
    if stat.S_ISREG(status.st_mode):
        raise InputError(f"{path}: larger than {_MOST_BYTES:,} bytes; name a smaller image file")
    what = "Is a directory" if stat.S_ISDIR(status.st_mode) else "a pipe or a device"
    raise InputError(f"{path}: cannot be read ({what}); name a readable image file")


def _eight_bits(pixels: NDArray[Any], greatest: int | None, warn: Warn) -> Image:
    """The highest 8 bits of those that are used: of 16, cameras may use 10 or 12. greatest: the
    value of white, if it is known."""
    if pixels.dtype == np.uint8:
        return np.asarray(pixels, np.uint8)
    if greatest is not None:
        return np.asarray(np.minimum(pixels.astype(np.uint32) * 255 // greatest, 255), np.uint8)
    used = int(pixels.max()).bit_length()
    used = 16 if used == 0 else max(used + used % 2, 8)
    if used < 16:
        warn(
            f"an image uses {used} of its 16 bits; it, and others like it, are made "
            f"{2 ** (16 - used)} times as bright"
        )
    return (pixels >> (used - 8)).astype(np.uint8)


def _upright(image: Image, turned: int) -> Image:
    """An image turned back from EXIF's orientation, 1 to 8; others mean nothing."""
    if turned in (5, 6, 7, 8):
        image = image.transpose(1, 0, 2)
    if turned in (2, 3, 6, 7):
        image = image[:, ::-1]
    if turned in (3, 4, 7, 8):
        image = image[::-1]
    return np.ascontiguousarray(image)
