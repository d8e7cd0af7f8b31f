"""Image files whose pixels or proportions OpenCV misreads."""

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from shaftpose.core.errors import InputError
from shaftpose.image_files.oddities import misread, oblong
from shaftpose.image_files.reading import read_rgb
from tests.image_files.made_files import corner_marked, encoded, png_chunk

IMAGE = corner_marked()
GREY = IMAGE[:, :, 0]


def white_is_zero(data: bytes) -> bytes:
    """A TIFF file of one brightness, of which 0 is white."""
    entry = struct.pack("<HHI", 262, 3, 1)
    assert data.count(entry + b"\1") == 1
    return data.replace(entry + b"\1", entry + b"\0")


def complaint(folder: Path, data: bytes) -> str:
    path = folder / "image"
    path.write_bytes(data)
    with pytest.raises(InputError) as caught:
        read_rgb(path)
    return str(caught.value)


def fail(*_: object) -> None:
    raise AssertionError("decoded")


@pytest.mark.parametrize("place", [8, 33])  # of the header, of the pixels
def test_a_part_longer_than_its_file_is_not_decoded(
    place: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """OpenCV would set aside 2.8 GB."""
    data = bytearray(encoded(".png", IMAGE))
    data[place : place + 4] = (2_800_000_000).to_bytes(4, "big")
    monkeypatch.setattr(cv2, "imdecode", fail)
    assert "not a readable image" in complaint(tmp_path, bytes(data))


def test_what_follows_the_end_of_an_image_means_nothing(tmp_path: Path) -> None:
    path = tmp_path / "image.png"
    path.write_bytes(encoded(".png", IMAGE) + b"\xff" * 100)
    np.testing.assert_array_equal(read_rgb(path), IMAGE)


def test_brightness_that_opencv_misreads_is_refused(tmp_path: Path) -> None:
    sixteen = GREY.astype(np.uint16) * 257
    dark = b"P5 # up to 100\n60 40\n100\n" + (GREY // 4).tobytes()
    assert "negative" in complaint(tmp_path, encoded(".tiff", sixteen.astype(np.int16)))
    assert "white as 0" in complaint(tmp_path, white_is_zero(encoded(".tiff", sixteen)))
    assert "at most 100" in complaint(tmp_path, dark)
    assert "red and blue" in complaint(tmp_path, encoded(".pam", IMAGE))
    assert "separate planes" in complaint(tmp_path, planes_apart(IMAGE.astype(np.uint16)))


def planes_apart(image: NDArray[np.uint16]) -> bytes:
    """A TIFF file of 16 bits whose colours follow one another."""
    height, width, _ = image.shape
    plane, entries = 2 * height * width, []
    bits, places, sizes = 200, 210, 230  # where lists of three numbers are
    for tag, kind, count, value in (
        (256, 3, 1, width), (257, 3, 1, height), (258, 3, 3, bits), (259, 3, 1, 1), (262, 3, 1, 2),
        (273, 4, 3, places), (277, 3, 1, 3), (278, 3, 1, height), (279, 4, 3, sizes),
        (284, 3, 1, 2),
    ):  # fmt: skip
        entries.append(struct.pack("<HHII", tag, kind, count, value))
    head = b"II*\0" + struct.pack("<IH", 8, len(entries)) + b"".join(entries) + bytes(4)
    head = head.ljust(bits, b"\0") + struct.pack("<3H", 16, 16, 16)
    head = head.ljust(places, b"\0") + struct.pack("<3I", *(256 + n * plane for n in range(3)))
    head = head.ljust(sizes, b"\0") + struct.pack("<3I", plane, plane, plane)
    return head.ljust(256, b"\0") + image.transpose(2, 0, 1).tobytes()


def bitmap(masks: tuple[int, int, int], image: NDArray[np.uint8]) -> bytes:
    """A BMP file of 32 bits, from the lowest row up, with these masks of red, green and blue."""
    height, width, _ = image.shape
    values = sum(
        image[::-1, :, n].astype(np.uint32) * (mask & -mask) for n, mask in enumerate(masks)
    )
    pixels = np.asarray(values, "<u4").tobytes()
    header = struct.pack("<IiiHHIIiiII", 40, width, height, 1, 32, 3, len(pixels), 0, 0, 0, 0)
    begin = b"BM" + struct.pack("<IHHI", 66 + len(pixels), 0, 0, 66)
    return begin + header + struct.pack("<3I", *masks) + pixels


def test_colours_of_a_bitmap_are_in_their_usual_order(tmp_path: Path) -> None:
    path = tmp_path / "usual.bmp"
    path.write_bytes(bitmap((0xFF0000, 0xFF00, 0xFF), IMAGE))
    np.testing.assert_array_equal(read_rgb(path), IMAGE)
    assert "order of colours" in complaint(tmp_path, bitmap((0xFF, 0xFF00, 0xFF0000), IMAGE))


def test_a_brightness_that_is_stated_is_white(tmp_path: Path) -> None:
    path, said = tmp_path / "image.pgm", list[str]()
    values = np.array([[0, 150, 300]], ">u2")
    path.write_bytes(b"P5 3 1 300\n" + values.tobytes())
    np.testing.assert_array_equal(read_rgb(path, said.append)[0, :, 0], [0, 127, 255])
    assert said == []


@pytest.mark.parametrize("suffix", [".tiff", ".pgm", ".png", ".jpg"])
@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_other_files_are_read_as_they_are(suffix: str, kind: type[np.integer]) -> None:
    assert misread(encoded(suffix, GREY.astype(kind) if suffix != ".jpg" else GREY)) == ""


def test_white_that_is_zero_in_8_bits_is_read(tmp_path: Path) -> None:
    path = tmp_path / "image.tiff"
    path.write_bytes(white_is_zero(encoded(".tiff", GREY)))
    np.testing.assert_array_equal(read_rgb(path), 255 - IMAGE)


def test_pixels_that_are_not_square_are_told(tmp_path: Path) -> None:
    jpeg, png = encoded(".jpg", IMAGE), encoded(".png", IMAGE)
    stated = jpeg[:13] + struct.pack(">BHH", 0, 64, 45) + jpeg[18:]
    physical = png_chunk(b"pHYs", struct.pack(">IIB", 64, 45, 0))
    assert oblong(jpeg) is oblong(png) is None
    assert (
        oblong(png[:33] + png_chunk(b"pHYs", struct.pack(">IIB", 2835, 2834, 1)) + png[33:]) is None
    )
    assert oblong(stated) == oblong(png[:33] + physical + png[33:]) == (64, 45)
    path, warnings = tmp_path / "image.jpg", list[str]()
    path.write_bytes(stated)
    read_rgb(path, warnings.append)
    (warning,) = warnings
    assert warning.startswith(f"{path}: states pixels that are not square (64 : 45)")
