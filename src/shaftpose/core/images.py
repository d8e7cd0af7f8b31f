"""Reading, writing and cropping images: (H, W, 3) uint8 RGB in memory."""

import logging
import os
import stat
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose import MOST_PIXELS
from shaftpose.core.errors import InputError, Warn
from shaftpose.core.files import new_file
from shaftpose.core.image_formats import orientation, picture_count, still
from shaftpose.core.image_oddities import misread, oblong, overruns

Image = NDArray[np.uint8]

_MOST_BYTES = 2**30  # of an image file, which is read as a whole
_log = logging.getLogger(__name__)


def decode_rgb(data: bytes) -> Image | None:
    """An encoded image, or None if it cannot be decoded or was cut short."""
    raw = np.frombuffer(data, dtype=np.uint8)
    try:
        bgr = cv2.imdecode(raw, cv2.IMREAD_COLOR) if raw.size else None
    except cv2.error:  # the header states a size that OpenCV refuses
        return None
    return None if bgr is None else np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), np.uint8)


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
    bgr = _upright(_eight_bits(pixels, warn), turned or 1)
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


def _eight_bits(pixels: NDArray[Any], warn: Warn) -> Image:
    """The highest 8 bits of those that are used: of 16, cameras may use 10 or 12."""
    if pixels.dtype == np.uint8:
        return np.asarray(pixels, np.uint8)
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


def encode_jpeg(rgb: Image, quality: int) -> bytes:
    """The bytes of a JPEG file; deterministic for the same pixels and OpenCV version.

    Raises InputError if the image is too large for a JPEG.
    """
    bgr = cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR)
    encoded, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])
    if not encoded:
        height, width = rgb.shape[:2]
        raise InputError(f"{width} x {height} px: a JPEG has at most 65,500 on a side; draw less")
    return data.tobytes()


def write_jpeg(rgb: Image, path: Path, quality: int = 95) -> None:
    """Write an image; creates the folder if needed."""
    with new_file(path) as part:
        part.write_bytes(encode_jpeg(rgb, quality))


def centre_square(image: Image, size_px: int) -> Image:
    """The central square of an image (H, W, 3) or a mask (H, W) of 0 and 1, resized to size_px."""
    height, width = image.shape[:2]
    side = min(height, width)
    top, left = (height - side) // 2, (width - side) // 2
    return resized(image[top : top + side, left : left + side], size_px, size_px)


def resized(image: Image, width: int, height: int) -> Image:
    """An image (H, W, 3) or a mask (H, W) in another size, averaged if it shrinks."""
    method = cv2.INTER_AREA if image.shape[1] > width else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(image, (width, height), interpolation=method), np.uint8)
