"""Videos for tests."""

import struct
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np

# What precedes the boxes inside of a box of MP4.
_BEFORE = {b"stsd": 8, b"mp4v": 78}


def write_video(path: Path, greys: Sequence[int], width: int = 64, height: int = 48) -> Path:
    """Frames of one grey each, 10 a second, 25 in an MPEG file; in an AVI file, each is compressed
    on its own."""
    name, fps = {".mp4": ("mp4v", 10), ".mpg": ("MPG2", 25)}.get(path.suffix, ("MJPG", 10))
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*name), fps, (width, height))
    assert writer.isOpened()
    for grey in greys:
        writer.write(np.full((height, width, 3), grey, dtype=np.uint8))
    writer.release()
    return path


def read_greys(path: Path) -> list[float]:
    """The mean brightness of each frame."""
    capture, greys = cv2.VideoCapture(str(path)), []
    while (frame := capture.read()[1]) is not None:
        greys.append(float(frame.mean()))
    return greys


def edit_box(path: Path, names: Sequence[bytes], change: Callable[[bytes], bytes]) -> Path:
    """Change the content of the box that these names lead to in an MP4 file of OpenCV, which has
    its boxes at the end, so that no frame moves."""
    path.write_bytes(_edited(path.read_bytes(), 0, names, change))
    return path


def _edited(
    data: bytes, place: int, names: Sequence[bytes], change: Callable[[bytes], bytes]
) -> bytes:
    if not names:
        return change(data)
    while data[place + 4 : place + 8] != names[0]:
        place += int.from_bytes(data[place : place + 4], "big")
        assert place < len(data), f"no box {names[0]!r}"
    end = place + int.from_bytes(data[place : place + 4], "big")
    content = _edited(data[place + 8 : end], _BEFORE.get(names[0], 0), names[1:], change)
    return data[:place] + box(names[0], content) + data[end:]


def box(name: bytes, content: bytes) -> bytes:
    """A box of MP4."""
    return struct.pack(">I", len(content) + 8) + name + content


def element(name: bytes, content: bytes) -> bytes:
    """An element of Matroska, whose length takes 4 bytes."""
    return name + (len(content) | 1 << 28).to_bytes(4, "big") + content


def write_matroska(path: Path, greys: Sequence[int], times_ms: Sequence[int], end_ms: int) -> Path:
    """Frames of one grey each, at any times, in a film that lasts until `end_ms`."""
    track = b"".join(
        element(bytes.fromhex(name), content)
        for name, content in (
            ("d7", b"\1"), ("73c5", b"\1"), ("83", b"\1"), ("86", b"V_MJPEG"),
            ("e0", element(b"\xb0", b"\x40") + element(b"\xba", b"\x30")),
        )
    )  # fmt: skip
    clusters = b"".join(
        element(b"\x1fC\xb6u", element(b"\xe7", time.to_bytes(4, "big"))
                + element(b"\xa3", b"\x81\0\0\x80" + _jpeg(grey)))
        for grey, time in zip(greys, times_ms, strict=True)
    )  # fmt: skip
    length = element(b"\x44\x89", struct.pack(">d", end_ms))
    info = element(b"\x15I\xa9f", element(b"\x2a\xd7\xb1", b"\x0f\x42\x40") + length)
    tracks = element(b"\x16T\xaek", element(b"\xae", track))
    head = element(b"\x1aE\xdf\xa3", element(b"\x42\x82", b"matroska"))
    path.write_bytes(head + element(b"\x18S\x80g", info + tracks + clusters))
    return path


def _jpeg(grey: int) -> bytes:
    return cv2.imencode(".jpg", np.full((48, 64, 3), grey, dtype=np.uint8))[1].tobytes()


TRACK = (b"moov", b"trak")
TABLES = (*TRACK, b"mdia", b"minf", b"stbl")


def with_pixel_aspect(path: Path, width: int, height: int) -> Path:
    """State the shape of an MP4 file's pixels."""
    stated = box(b"pasp", struct.pack(">2I", width, height))
    return edit_box(path, (*TABLES, b"stsd", b"mp4v"), lambda content: content + stated)
