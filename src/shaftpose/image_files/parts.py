"""The parts of image files, which may be damaged."""

from collections.abc import Iterator
from itertools import islice
from typing import Literal

MOST_PARTS = 100_000  # of a file, that are looked at


class Tiff:
    """The directories of a TIFF file, which may be damaged; EXIF data are one, too."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._order: Literal["little", "big"] = "little" if data[:2] == b"II" else "big"
        # Of a number, an entry and the count of entries.
        self._sizes = (8, 20, 8) if self._number(2, 2) == 43 else (4, 12, 2)

    def directories(self) -> Iterator[int]:
        """The place of each page's directory."""
        size, entry, count = self._sizes
        place, seen = self._number(size, size), set[int]()
        while 0 < place < len(self._data) and place not in seen:
            seen.add(place)
            yield place
            place = self._number(place + count + entry * self._number(place, count), size)

    def first(self, tag: int, usual: int) -> int:
        """A number of 16 bits of the first page, the first one of several; `usual` if there is
        none."""
        size, entry, count = self._sizes
        for place in islice(self.directories(), 1):
            entries = min(self._number(place, count), MOST_PARTS)
            for at in range(place + count, place + count + entry * entries, entry):
                if self._number(at, 2) == tag:
                    within = 2 * self._number(at + 4, size) <= size
                    value = at + 4 + size
                    return self._number(value if within else self._number(value, size), 2)
        return usual

    def _number(self, place: int, size: int) -> int:
        return int.from_bytes(self._data[place : place + size], self._order)


def png_chunks(data: bytes) -> Iterator[bytes]:
    """The chunks of a PNG file: 4 bytes of length, 4 of name, content, 4 of checksum; `IEND`
    is the last."""
    place = 8
    for _ in range(MOST_PARTS):
        if place >= len(data):
            return
        end = place + 12 + int.from_bytes(data[place : place + 4], "big")
        yield data[place:end]
        if data[place + 4 : place + 8] == b"IEND":
            return
        place = end


def riff_chunks(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """The names and contents of the chunks of a RIFF file."""
    place = 12
    for _ in range(MOST_PARTS):
        if place >= len(data):
            return
        size = int.from_bytes(data[place + 4 : place + 8], "little")
        yield data[place : place + 4], data[place + 8 : place + 8 + size]
        place += 8 + size + size % 2
