"""Image files by their content: whether they are images, how many pictures they hold, and how these
are turned. OpenCV decodes the pixels, but neither tells nor does all of this."""

import re
from collections.abc import Iterator
from itertools import islice, takewhile
from typing import Literal

HEAD_BYTES = 32  # that `has_image_head` needs
# JPEG, PNG, BMP, TIFF, JPEG 2000 (two forms), PNM and PFM, WebP, AVIF and HEIC, Sun, EXR, HDR.
_BEGINNINGS = re.compile(
    rb"\xff\xd8\xff|\x89PNG\r\n|BM.{4}\0{4}|II[*+]\0|MM\0[*+]|\0\0\0\x0cjP  |\xff\x4f\xff\x51|"
    rb"P[1-7Ff]\s|RIFF.{4}WEBP|.{4}ftyp(avi[fs]|hei[cmsx]|hev[cmsx]|mi[af]1|msf1)|"
    rb"\x59\xa6\x6a\x95|v/1\x01|#\?R",
    re.DOTALL,
)
_MOST_PARTS = 100_000  # of a file, that are looked at
_ORIENTATION = 0x112  # EXIF's tag
_ANIMATION = (b"acTL", b"fcTL", b"fdAT")  # chunks of animated PNG


def has_image_head(head: bytes) -> bool:
    """Whether a file with these first bytes is an image."""
    return _BEGINNINGS.match(head) is not None


def picture_count(data: bytes) -> int:
    """The pages or animated pictures of an image file; 1 for formats that have no more."""
    if data[:2] in (b"II", b"MM"):
        return sum(1 for _ in islice(_Tiff(data).directories(), _MOST_PARTS))
    if data[:4] == b"\x89PNG":
        counts = (int.from_bytes(chunk[8:12], "big") for chunk in _animation(data))
        return next(counts, 1)
    if data[:4] == b"RIFF":
        return max(sum(name == b"ANMF" for name, _ in _riff_chunks(data)), 1)
    if data[8:12] == b"avis" and (table := data.find(b"stsz")) > 0:
        return int.from_bytes(data[table + 12 : table + 16], "big")
    return 1


def overruns(data: bytes) -> bool:
    """Whether a PNG file states a part that is longer than the file: OpenCV would set aside memory
    for it."""
    chunks = _png_chunks(data) if data[:4] == b"\x89PNG" else iter(())
    return any(len(chunk) < 12 + int.from_bytes(chunk[:4], "big") for chunk in chunks)


def still(data: bytes) -> bytes:
    """The file with its first picture alone, where OpenCV 4.11 crashes on damaged others."""
    if data[:4] != b"\x89PNG" or next(_animation(data), None) is None:
        return data
    return data[:8] + b"".join(c for c in _png_chunks(data) if c[4:8] not in _ANIMATION)


def orientation(data: bytes) -> int | None:
    """EXIF's orientation, 1 to 8, of formats in which OpenCV does not apply it, or not in all
    versions; None for the other formats."""
    if data[8:12] == b"WEBP":
        exif = next((chunk for name, chunk in _riff_chunks(data) if name == b"EXIF"), b"")
        return _Tiff(exif.removeprefix(b"Exif\0\0")).orientation()
    if data[4:8] == b"ftyp":
        place = data.find(b"irot")  # quarter turns to the left
        turns = data[place + 4] & 3 if 0 < place < len(data) - 4 else 0
        return (1, 8, 3, 6)[turns]
    return None


class _Tiff:
    """The directories of a TIFF file, which may be damaged; EXIF data are one, too."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._order: Literal["little", "big"] = "little" if data[:2] == b"II" else "big"
        self._big = self._number(2, 2) == 43

    def directories(self) -> Iterator[int]:
        """The place of each page's directory."""
        size, entry, count = (8, 20, 8) if self._big else (4, 12, 2)
        place, seen = self._number(8 if self._big else 4, size), set[int]()
        while 0 < place < len(self._data) and place not in seen:
            seen.add(place)
            yield place
            place = self._number(place + count + entry * self._number(place, count), size)

    def orientation(self) -> int:
        """That of the first page; 1 if it states none."""
        for place in self.directories():
            for at in range(place + 2, place + 2 + 12 * self._number(place, 2), 12):
                if self._number(at, 2) == _ORIENTATION:
                    return self._number(at + 8, 2)
            break
        return 1

    def _number(self, place: int, size: int) -> int:
        return int.from_bytes(self._data[place : place + size], self._order)


def _png_chunks(data: bytes) -> Iterator[bytes]:
    """The chunks of a PNG file: 4 bytes of length, 4 of name, content, 4 of checksum; the
    last one is `IEND`."""
    place = 8
    for _ in range(_MOST_PARTS):
        if place >= len(data):
            return
        end = place + 12 + int.from_bytes(data[place : place + 4], "big")
        yield data[place:end]
        if data[place + 4 : place + 8] == b"IEND":
            return
        place = end


def _animation(data: bytes) -> Iterator[bytes]:
    """The chunk of a PNG file that announces an animation, if there is one."""
    header = takewhile(lambda chunk: chunk[4:8] != b"IDAT", _png_chunks(data))
    return (chunk for chunk in header if chunk[4:8] == b"acTL")


def _riff_chunks(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """The names and contents of the chunks of a RIFF file."""
    place = 12
    for _ in range(_MOST_PARTS):
        if place >= len(data):
            return
        size = int.from_bytes(data[place + 4 : place + 8], "little")
        yield data[place : place + 4], data[place + 8 : place + 8 + size]
        place += 8 + size + size % 2
