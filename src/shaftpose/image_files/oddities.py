"""Image files that OpenCV decodes to other pixels than they hold, or with other proportions."""

import re
from itertools import takewhile

from shaftpose.image_files.parts import Tiff, png_chunks

# TIFF's tags.
_BITS, _PHOTOMETRIC, _SAMPLES, _PLANES, _SAMPLE_FORMAT = 258, 262, 277, 284, 339
_APART = 2  # of planes: each colour by itself
_WHITE_IS_ZERO, _RGB = 0, 2  # photometrics: white, black (1) or RGB; others are encodings
_SIGNED = 2  # sample format
_SPACE = rb"(?:\s+|#[^\n]*\n)+"
_PNM_HEADER = re.compile(rb"P[2356]" + 3 * (_SPACE + rb"(\d+)"))
# BMP with the shortest header, 32 bits and masks of its colours, and the usual masks.
_BITMAP_WITH_MASKS = re.compile(rb"BM.{12}\x28\0{3}.{10}\x20\0\x03\0{3}", re.DOTALL)
_BLUE_FIRST = b"\0\0\xff\0\0\xff\0\0\xff\0\0\0"
_ROUNDING = 0.01  # of resolutions in whole numbers


def overruns(data: bytes) -> bool:
    """Whether a PNG file states a part that is longer than the file: OpenCV would set aside memory
    for it."""
    chunks = png_chunks(data) if data[:4] == b"\x89PNG" else iter(())
    return any(len(chunk) < 12 + int.from_bytes(chunk[:4], "big") for chunk in chunks)


def misread(data: bytes) -> str:
    """Why OpenCV decodes a file to other pixels than it holds; empty if it does not."""
    if data[:2] == b"P7":
        return "PAM, of which OpenCV swaps red and blue"
    header = _PNM_HEADER.match(data)
    if header and int(header[3]) < 255:
        return f"states a brightness of at most {int(header[3])}, not 255, which OpenCV ignores"
    if data[:2] in (b"II", b"MM"):
        tiff = Tiff(data)
        photometric = tiff.first(_PHOTOMETRIC, 1)
        if tiff.first(_SAMPLE_FORMAT, 1) == _SIGNED and photometric <= _RGB:
            return "its numbers may be negative, which OpenCV ignores"
        if photometric == _WHITE_IS_ZERO and tiff.first(_BITS, 1) > 8:
            return "stores white as 0, which OpenCV ignores beyond 8 bits"
        apart = tiff.first(_PLANES, 1) == _APART and tiff.first(_SAMPLES, 1) > 1
        if apart and tiff.first(_BITS, 1) > 8:
            return "stores its colours in separate planes, which OpenCV misreads beyond 8 bits"
    if _BITMAP_WITH_MASKS.match(data) and data[54:66] != _BLUE_FIRST:
        return "states an order of colours that OpenCV ignores"
    return ""


def greatest_value(data: bytes) -> int | None:
    """The brightness that a PNM file of more than 8 bits states as its greatest; None for other
    files."""
    header = _PNM_HEADER.match(data)
    return int(header[3]) if header and int(header[3]) > 255 else None


def oblong(data: bytes) -> tuple[int, int] | None:
    """The horizontal and vertical numbers by which a JPEG or PNG file states that its pixels are
    not square. Programs do not agree on which way."""
    sides = b""
    if data[6:11] == b"JFIF\0":
        sides = data[14:18]
    elif data[:4] == b"\x89PNG":
        header = takewhile(lambda chunk: chunk[4:8] != b"IDAT", png_chunks(data))
        sides = next((chunk[8:16] for chunk in header if chunk[4:8] == b"pHYs"), b"")
    half = len(sides) // 2
    x, y = (int.from_bytes(side, "big") for side in (sides[:half], sides[half:]))
    return (x, y) if x and y and abs(x / y - 1) > _ROUNDING else None
