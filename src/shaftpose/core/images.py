"""Images in memory, (H, W, 3) uint8 RGB, and those that this project has written itself.

`image_files.reading` reads the files of others.
"""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.core.errors import InputError
from shaftpose.core.files import new_file

Image = NDArray[np.uint8]


def decode_rgb(data: bytes) -> Image | None:
    """An encoded image, or None if it cannot be decoded or was cut short."""
    raw = np.frombuffer(data, dtype=np.uint8)
    try:
        bgr = cv2.imdecode(raw, cv2.IMREAD_COLOR) if raw.size else None
    except cv2.error:  # the header states a size that OpenCV refuses
        return None
    return None if bgr is None else np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), np.uint8)


def read_written(path: Path) -> Image:
    """The image in a file that this project has written.

    Raises InputError naming the file if it is missing or damaged.
    """
    try:
        rgb = decode_rgb(path.read_bytes())
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({error.strerror}); run its stage again"
        ) from error
    if rgb is None:
        raise InputError(f"{path}: damaged; delete it, and run its stage again")
    return rgb


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
