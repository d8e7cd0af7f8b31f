"""Image files by their content."""

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from shaftpose.core.errors import InputError
from shaftpose.image_files.formats import HEAD_BYTES, has_image_head, picture_count, still
from shaftpose.image_files.reading import read_rgb
from tests.image_files.made_files import (
    animated_png,
    corner_marked,
    encoded,
    jpeg_with_exif,
    riff_chunk,
    webp,
    webp_with_exif,
)

IMAGE = corner_marked()
# EXIF's orientation -> the bright quarter (row, column) and whether width and height are swapped.
TURNED = {
    1: (0, 0, False), 2: (0, 1, False), 3: (1, 1, False), 4: (1, 0, False),
    5: (0, 0, True), 6: (0, 1, True), 7: (1, 1, True), 8: (1, 0, True),
}  # fmt: skip


def fail(message: str) -> None:
    raise AssertionError(message)


def written(folder: Path, data: bytes) -> Path:
    path = folder / "image"
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("suffix", ["jpg", "png", "bmp", "tiff", "webp", "jp2", "ppm", "ras"])
def test_an_image_is_known_by_its_first_bytes(suffix: str) -> None:
    assert has_image_head(encoded(f".{suffix}", IMAGE)[:HEAD_BYTES])


@pytest.mark.parametrize(
    "head", [b"", b"BMW.txt", b"P1 is a text"[1:], b"RIFF\0\0\0\0AVI LIST", b"\0\0\0\x20ftypisom"]
)
def test_other_files_are_no_images(head: bytes) -> None:
    assert not has_image_head(head)


@pytest.mark.parametrize("orientation", TURNED)
@pytest.mark.parametrize("write", [jpeg_with_exif, webp_with_exif])
def test_an_image_is_turned_as_exif_says(write: object, orientation: int, tmp_path: Path) -> None:
    assert callable(write)
    rgb = read_rgb(written(tmp_path, write(IMAGE, orientation)), fail)
    row, column, swapped = TURNED[orientation]
    height, width = rgb.shape[:2]
    assert (height, width) == ((60, 40) if swapped else (40, 60))
    quarters = rgb.reshape(2, height // 2, 2, width // 2, 3).mean(axis=(1, 3, 4))
    assert quarters.argmax() == 2 * row + column
    assert np.sort(quarters.ravel())[-2:] == pytest.approx([20, 220], abs=8)


def test_pages_are_counted_and_the_first_is_read(tmp_path: Path) -> None:
    path = tmp_path / "stack.tif"
    assert cv2.imwritemulti(str(path), [IMAGE, IMAGE[::-1], IMAGE[:, ::-1]])
    warnings: list[str] = []
    np.testing.assert_array_equal(read_rgb(path, warnings.append), IMAGE)
    assert warnings == [f"{path}: holds 3 pictures; all but the first are left out, 2"]


def test_a_tiff_whose_pages_form_a_circle_ends() -> None:
    # A directory without entries at byte 8, whose successor is itself.
    assert picture_count(b"II*\0" + struct.pack("<IHI", 8, 0, 8)) == 1


def test_pictures_of_animated_webp_are_counted() -> None:
    picture = riff_chunk(b"ANMF", bytes(16))
    assert picture_count(webp(riff_chunk(b"ANIM", bytes(6)), picture, picture, picture)) == 3
    assert picture_count(encoded(".webp", IMAGE)) == 1


def test_a_damaged_animation_leaves_its_first_picture(tmp_path: Path) -> None:
    """OpenCV 4.11 would crash the process."""
    data, warnings = animated_png(IMAGE, b"no picture"), list[str]()
    assert picture_count(data) == 2
    np.testing.assert_array_equal(read_rgb(written(tmp_path, data), warnings.append), IMAGE)
    assert len(warnings) == 1
    assert still(data) == encoded(".png", IMAGE)


def test_joined_jpeg_files_are_counted(tmp_path: Path) -> None:
    """Such as a film of JPEG files without a container."""
    data, warnings = encoded(".jpg", IMAGE), list[str]()
    assert picture_count(data) == 1
    read_rgb(written(tmp_path, data + data + data), warnings.append)
    assert warnings == [f"{tmp_path}/image: holds 3 pictures; all but the first are left out, 2"]


@pytest.mark.parametrize(("bits", "used"), [(8, 8), (10, 10), (11, 12), (12, 12), (14, 14)])
def test_all_used_bits_are_seen(bits: int, used: int, tmp_path: Path) -> None:
    grey = np.linspace(0, 2**bits - 1, 2400).astype(np.uint16).reshape(40, 60)
    warnings: list[str] = []
    rgb = read_rgb(written(tmp_path, encoded(".png", grey)), warnings.append)
    np.testing.assert_array_equal(rgb[..., 1], grey >> (used - 8))
    assert warnings == [
        f"an image uses {used} of its 16 bits; it, and others like it, are made "
        f"{2 ** (16 - used)} times as bright"
    ]


@pytest.mark.parametrize("most", [0, 40_000, 65_535])
def test_sixteen_bits_stay_as_they_are(most: int, tmp_path: Path) -> None:
    grey = np.linspace(0, most, 2400).astype(np.uint16).reshape(40, 60)
    rgb = read_rgb(written(tmp_path, encoded(".tiff", grey)), fail)
    np.testing.assert_array_equal(rgb[..., 1], grey >> 8)


def test_decimal_numbers_are_no_brightness(tmp_path: Path) -> None:
    path = written(tmp_path, encoded(".tiff", (IMAGE / 255).astype(np.float32)))
    with pytest.raises(InputError, match="its pixels are decimal numbers"):
        read_rgb(path, fail)
