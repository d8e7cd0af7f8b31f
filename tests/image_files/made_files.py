"""Image files for tests, put together by hand."""

import struct
import zlib

import cv2
import numpy as np
from numpy.typing import NDArray


def corner_marked(height: int = 40, width: int = 60) -> NDArray[np.uint8]:
    """A dark image with a bright first quarter, (height, width, 3)."""
    image = np.full((height, width, 3), 20, dtype=np.uint8)
    image[: height // 2, : width // 2] = 220
    return image


def encoded(suffix: str, image: NDArray[np.integer], *options: int) -> bytes:
    return cv2.imencode(suffix, image, options)[1].tobytes()


def exif(orientation: int) -> bytes:
    """A TIFF directory with EXIF's orientation alone."""
    entry = struct.pack("<HHIHH", 0x112, 3, 1, orientation, 0)
    return b"II*\0" + struct.pack("<IH", 8, 1) + entry + bytes(4)


def jpeg_with_exif(image: NDArray[np.uint8], orientation: int) -> bytes:
    data, content = encoded(".jpg", image), b"Exif\0\0" + exif(orientation)
    return data[:2] + b"\xff\xe1" + struct.pack(">H", len(content) + 2) + content + data[2:]


def riff_chunk(name: bytes, content: bytes) -> bytes:
    return name + struct.pack("<I", len(content)) + content + bytes(len(content) % 2)


def webp(*chunks: bytes) -> bytes:
    """Chunks after the header that announces EXIF data."""
    header = riff_chunk(b"VP8X", struct.pack("<I", 8) + bytes([59, 0, 0, 39, 0, 0]))
    body = b"WEBP" + header + b"".join(chunks)
    return b"RIFF" + struct.pack("<I", len(body)) + body


def webp_with_exif(image: NDArray[np.uint8], orientation: int) -> bytes:
    picture = encoded(".webp", image, cv2.IMWRITE_WEBP_QUALITY, 95)[12:]
    return webp(picture, riff_chunk(b"EXIF", exif(orientation)))


def png_chunk(name: bytes, content: bytes) -> bytes:
    checksum = struct.pack(">I", zlib.crc32(name + content))
    return struct.pack(">I", len(content)) + name + content + checksum


def animated_png(image: NDArray[np.uint8], second: bytes) -> bytes:
    """Two pictures, of which the second has this compressed content."""
    data = encoded(".png", image)
    height, width = image.shape[:2]

    def control(number: int) -> bytes:
        return png_chunk(b"fcTL", struct.pack(">5I2H2B", number, width, height, 0, 0, 1, 10, 0, 0))

    start = png_chunk(b"acTL", struct.pack(">2I", 2, 0)) + control(0)
    more = control(1) + png_chunk(b"fdAT", struct.pack(">I", 2) + second)
    return data[:33] + start + data[33:-12] + more + data[-12:]
