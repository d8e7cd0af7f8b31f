"""Headers of video containers: whether a file was cut short or asks for a mirrored picture, its
duration and its number of video tracks."""

import re
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

_BOXES = (b"ftyp", b"moov", b"mdat", b"free", b"skip", b"wide")  # that MP4 and MOV begin with
_EBML, _SEGMENT = b"\x1aE\xdf\xa3", b"\x18S\x80g"  # of Matroska and WebM
# WMV's beginning, and that of the object in its header that tells the file's size.
_ASF = bytes.fromhex("3026b2758e66cf11")
_ASF_FILE = bytes.fromhex("a1dcab8c47a9cf118ee400c00c205365")
_PACKETS = ((0, 188), (4, 192))  # of MPEG transport streams: place of their sync byte, and length
_SYNC = 0x47
# Bytes that are read of headers.
_ASF_HEADER, _MATROSKA_HEADER, _MP4_HEADER = 1 << 16, 1 << 20, 1 << 26
_TRACKS, _MATROSKA_VIDEO = b"\x16\x54\xae\x6b", b"\x83\x81\x01"
_VIDEO_TRACK = re.compile(rb"hdlr\0{4}(?:\0{4}|mhlr)vide", re.DOTALL)
# Of both versions, up to the matrix of 16.16 numbers that turns the picture.
_TRACK_HEADER = re.compile(rb"tkhd(?:\x00.{39}|\x01.{51})(.{20})", re.DOTALL)
_RIFF_HEAD = 8  # bytes, which some recorders include in the stated size; a last byte may be spare
_MOST_BOXES = 1_000_000  # a film has two for each second at most


def counts_frames(path: Path) -> bool:
    """Whether a file is of a container that states an exact number of frames: MP4, MOV or AVI."""
    with path.open("rb") as file:
        head = file.read(12)
    return head[4:8] in _BOXES or head[:4] == b"RIFF"


def counts_from_zero(path: Path) -> bool:
    """Whether a file is Matroska or WebM, whose stated length includes the time before its first
    frame, such as of a later part of a recording."""
    with path.open("rb") as file:
        return file.read(4) == _EBML


def is_cut(path: Path) -> bool:
    """Whether a file ends before the parts that it states; False for other containers."""
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(2 * 192)
        if head[4:8] in _BOXES:
            return any(end > size for end in _box_ends(file, size))
        if head[:4] == b"RIFF":
            return any(end - size > 1 for end in _riff_ends(file, size) if end - size != _RIFF_HEAD)
        if head[:4] == _EBML:
            return _segment_end(file) > size
        if head[:8] == _ASF:
            return _asf_size(file) > size
    for place, length in _PACKETS:
        if len(head) > place + length and head[place] == head[place + length] == _SYNC:
            return size % length > 0
    return False


def video_tracks(path: Path) -> int:
    """The number of videos in a film, such as of two eyes; 1 for other containers than MP4, MOV,
    Matroska and WebM."""
    with path.open("rb") as file:
        if file.read(4) == _EBML:
            return max(_tracks(file, path.stat().st_size).count(_MATROSKA_VIDEO), 1)
    return max(len(_VIDEO_TRACK.findall(_mp4_header(path))), 1)


def film_seconds(path: Path) -> float | None:
    """How long an MP4 film lasts; None for other containers. The frame count of a film that was
    trimmed without being compressed again includes the trimmed frames."""
    header = _mp4_header(path)
    return _seconds(header[8:]) if header[4:8] == b"mvhd" else None


def is_mirrored(path: Path) -> bool:
    """Whether an MP4 film asks for a mirrored picture, which OpenCV does not show."""
    for header in _TRACK_HEADER.finditer(_mp4_header(path)):
        xx, xy, _, yx, yy = struct.unpack(">5i", header[1])
        if xx * yy < xy * yx:
            return True
    return False


def _mp4_header(path: Path) -> bytes:
    """The content of the box `moov`; empty for other containers."""
    with path.open("rb") as file:
        size = path.stat().st_size
        for start in (0, *_box_ends(file, size)):
            file.seek(min(start, size))
            head = file.read(8)
            if head[4:] == b"moov":
                length = int.from_bytes(head[:4], "big") or size  # 0: to the end
                return file.read(min(max(length - 8, 0), _MP4_HEADER))
    return b""


def _seconds(header: bytes) -> float | None:
    """Of the header of a film: version, two dates, ticks per second, and the length in ticks."""
    size = 8 if header[0] == 1 else 4
    ticks, length = (header[n : n + w] for n, w in ((4 + 2 * size, 4), (8 + 2 * size, size)))
    per_second, count = (int.from_bytes(number, "big") for number in (ticks, length))
    return count / per_second if per_second and count else None


def _box_ends(file: BinaryIO, size: int) -> Iterator[int]:
    """The ends of the outer boxes of an MP4 file; a length of 0 reaches to its end."""
    place = 0
    for _ in range(_MOST_BOXES):
        if place + 8 > size:
            return
        file.seek(place)
        header = file.read(16)
        length = int.from_bytes(header[:4], "big")
        if length == 1:
            length = int.from_bytes(header[8:], "big")
        if length < 8:
            return
        place += length
        yield place


def _riff_ends(file: BinaryIO, size: int) -> Iterator[int]:
    """The ends of the parts of an AVI file; one that was written to a pipe states none."""
    place = 0
    while place + 8 <= size:
        file.seek(place)
        header = file.read(8)
        length = int.from_bytes(header[4:], "little")
        if header[:4] != b"RIFF" or length in (0, 2**32 - 1):
            return
        place += 8 + length + length % 2
        yield place


def _segment_end(file: BinaryIO) -> int:
    """The end of a Matroska file's only segment, 0 if it states none. The file is then at the
    segment's content."""
    file.seek(4)
    file.seek(min(_ebml_size(file)[0], _MATROSKA_HEADER), 1)  # the system refuses to seek too far
    if file.read(4) != _SEGMENT:
        return 0
    length, known = _ebml_size(file)
    return file.tell() + length if known else 0


def _asf_size(file: BinaryIO) -> int:
    """The size that a WMV file states; 0 if it states none, as one that was written live."""
    file.seek(0)
    _, found, properties = file.read(_ASF_HEADER).partition(_ASF_FILE)
    live = not found or (properties[72:73] or b"\1")[0] & 1
    return 0 if live else int.from_bytes(properties[24:32], "little")


def _tracks(file: BinaryIO, size: int) -> bytes:
    """The description of a Matroska file's tracks; empty if the file is damaged."""
    _segment_end(file)
    while file.tell() < size:
        first = file.read(1)
        name = first + file.read(8 - first[0].bit_length())
        length, known = _ebml_size(file)
        if name == _TRACKS:
            return file.read(min(length, _MATROSKA_HEADER))
        if not known or length > size:
            break
        file.seek(length, 1)
    return b""


def _ebml_size(file: BinaryIO) -> tuple[int, bool]:
    """A number of 1 to 8 bytes, whose first bits tell how many, and whether it is known."""
    first = int.from_bytes(file.read(1), "big")
    more = 8 - first.bit_length()
    bits = 7 * (more + 1)
    number = int.from_bytes(bytes([first]) + file.read(more), "big") & (2**bits - 1)
    return number, number != 2**bits - 1
