"""Image files by their content: whether they are images, how many pictures they hold, and how these
are turned. OpenCV decodes the pixels, but neither tells nor does all of this."""

import re
from collections.abc import Iterator
from itertools import islice, takewhile

from shaftpose.image_files.parts import MOST_PARTS, Tiff, png_chunks, riff_chunks

HEAD_BYTES = 32  # that `has_image_head` needs
# JPEG, PNG, BMP, TIFF, JPEG 2000 (two forms), PNM and PFM, WebP, AVIF and HEIC, Sun, EXR, HDR.
_BEGINNINGS = re.compile(
    rb"\xff\xd8\xff|\x89PNG\r\n|BM.{4}\0{4}|II[*+]\0|MM\0[*+]|\0\0\0\x0cjP  |\xff\x4f\xff\x51|"
    rb"P[1-7Ff]\s|RIFF.{4}WEBP|.{4}ftyp(avi[fs]|hei[cmsx]|hev[cmsx]|mi[af]1|msf1)|"
    rb"\x59\xa6\x6a\x95|v/1\x01|#\?R",
    re.DOTALL,
)
_JPEG_BEGINS, _JPEG_ENDS = b"\xff\xd8", b"\xff\xd9"
_ORIENTATION = 0x112  # EXIF's tag
_ANIMATION = (b"acTL", b"fcTL", b"fdAT")  # chunks of animated PNG


def has_image_head(head: bytes) -> bool:
    """Whether a file with these first bytes is an image."""
    return _BEGINNINGS.match(head) is not None


def picture_count(data: bytes) -> int:
    """The pages, animated pictures or joined JPEG files of an image file; 1 for formats that have
    no more."""
    if data[:2] == _JPEG_BEGINS:
        return 1 + data.count(_JPEG_ENDS + _JPEG_BEGINS)
    if data[:2] in (b"II", b"MM"):
        return sum(1 for _ in islice(Tiff(data).directories(), MOST_PARTS))
    if data[:4] == b"\x89PNG":
        counts = (int.from_bytes(chunk[8:12], "big") for chunk in _animation(data))
        return next(counts, 1)
    if data[:4] == b"RIFF":
        return max(sum(name == b"ANMF" for name, _ in riff_chunks(data)), 1)
    if data[8:12] == b"avis" and (table := data.find(b"stsz")) > 0:
        return int.from_bytes(data[table + 12 : table + 16], "big")
    return 1


def still(data: bytes) -> bytes:
    """An animated PNG without its animation, any other file as it is: OpenCV 4.11 may crash on a
    damaged animation."""
    if data[:4] != b"\x89PNG" or next(_animation(data), None) is None:
        return data
    return data[:8] + b"".join(c for c in png_chunks(data) if c[4:8] not in _ANIMATION)


def orientation(data: bytes) -> int | None:
    """EXIF's orientation, 1 to 8, of formats in which OpenCV does not apply it, or not in all
    versions; None for the other formats."""
    if data[8:12] == b"WEBP":
        exif = next((chunk for name, chunk in riff_chunks(data) if name == b"EXIF"), b"")
        return Tiff(exif.removeprefix(b"Exif\0\0")).first(_ORIENTATION, 1)
    if data[4:8] == b"ftyp":
        place = data.find(b"irot")  # quarter turns to the left
        turns = data[place + 4] & 3 if 0 < place < len(data) - 4 else 0
        return (1, 8, 3, 6)[turns]
    return None


def _animation(data: bytes) -> Iterator[bytes]:
    """The chunk of a PNG file that announces an animation, if there is one."""
    header = takewhile(lambda chunk: chunk[4:8] != b"IDAT", png_chunks(data))
    return (chunk for chunk in header if chunk[4:8] == b"acTL")
