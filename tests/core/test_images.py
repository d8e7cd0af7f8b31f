"""Decoding, encoding and cropping of images."""

import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from shaftpose.core.errors import InputError
from shaftpose.core.images import centre_square, decode_rgb, encode_jpeg, read_written, write_jpeg


def smooth_image(height: int, width: int) -> np.ndarray:
    """(height, width, 3) a red ramp from left to right, a green one downwards, constant blue."""
    rows, columns = np.mgrid[0:height, 0:width]
    red, green = 255 * columns / (width - 1), 255 * rows / (height - 1)
    return np.stack([red, green, np.full_like(red, 60)], axis=-1).astype(np.uint8)


def test_centre_square_of_a_wide_image_by_hand() -> None:
    # 2 x 5: the square of side 2 starts at column (5 - 2) // 2 = 1.
    image = np.zeros((2, 5, 3), dtype=np.uint8)
    image[..., 0] = [[0, 10, 20, 30, 40], [50, 60, 70, 80, 90]]
    np.testing.assert_array_equal(centre_square(image, 2)[..., 0], [[10, 20], [60, 70]])


def test_centre_square_of_a_tall_image_by_hand() -> None:
    # 4 x 2: rows 1 and 2.
    image = np.zeros((4, 2, 3), dtype=np.uint8)
    image[..., 2] = [[1, 2], [3, 4], [5, 6], [7, 8]]
    np.testing.assert_array_equal(centre_square(image, 2)[..., 2], [[3, 4], [5, 6]])


def test_centre_square_shrinks_by_averaging() -> None:
    # 4 x 4 to 2 x 2: each pixel is the mean of its block, (0 + 4 + 8 + 12) / 4 = 6 in the first.
    image = np.zeros((4, 6, 3), dtype=np.uint8)
    image[:2, 1:3, 1] = [[0, 4], [8, 12]]
    image[2:, 3:5, 1] = 100
    np.testing.assert_array_equal(centre_square(image, 2)[..., 1], [[6, 0], [0, 100]])


def test_centre_square_enlarges() -> None:
    large = centre_square(np.full((3, 4, 3), 77, dtype=np.uint8), 10)
    assert large.shape == (10, 10, 3)
    assert np.all(large == 77)


@pytest.mark.parametrize("data", [b"", b"no image at all", b"\xff\xd8\xff\xe0 cut short"])
def test_garbage_is_no_image(data: bytes) -> None:
    assert decode_rgb(data) is None


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".bmp", ".tif"])
def test_a_truncated_file_is_no_image(suffix: str) -> None:
    data = cv2.imencode(suffix, smooth_image(40, 60))[1].tobytes()
    assert decode_rgb(data) is not None
    assert decode_rgb(data[: len(data) // 2]) is None


@pytest.mark.parametrize("missing", [1, 2, 500])
def test_a_jpeg_file_whose_last_bytes_are_missing_is_no_image(missing: int) -> None:
    """OpenCV's `imread` would fill the rest with grey."""
    noise = np.random.default_rng(0).integers(0, 256, (64, 64, 3), dtype=np.uint8)
    data = encode_jpeg(noise, 95)
    assert decode_rgb(data) is not None
    assert decode_rgb(data[:-missing]) is None


def test_a_header_that_states_a_giant_is_no_image() -> None:
    # The width of a PNG file is in bytes 16 to 19, the checksum of its header in bytes 29 to 32.
    data = bytearray(cv2.imencode(".png", smooth_image(40, 60))[1].tobytes())
    data[16:20] = (2**30).to_bytes(4, "big")
    data[29:33] = zlib.crc32(data[12:29]).to_bytes(4, "big")
    assert decode_rgb(bytes(data)) is None


def test_an_image_too_large_for_a_jpeg_is_refused() -> None:
    with pytest.raises(InputError, match=r"2 x 65501 px: a JPEG has at most 65,500"):
        encode_jpeg(np.zeros((65501, 2, 3), np.uint8), 90)


def test_jpeg_is_deterministic_and_close_to_the_image(tmp_path: Path) -> None:
    image = smooth_image(40, 60)
    assert encode_jpeg(image, 95) == encode_jpeg(image.copy(), 95)
    assert len(encode_jpeg(image, 30)) < len(encode_jpeg(image, 95))
    path = tmp_path / "new" / "folder" / "a.jpg"
    write_jpeg(image, path)
    back = read_written(path)
    assert back.shape == (40, 60, 3)
    # Red and blue differ by up to 195 levels here: swapped channels would show.
    assert np.abs(back.astype(int) - image).mean() < 3


def test_a_missing_or_damaged_image_of_ours_is_named(tmp_path: Path) -> None:
    path = tmp_path / "a.jpg"
    with pytest.raises(InputError, match=r"a\.jpg: cannot be read \(No such file"):
        read_written(path)
    write_jpeg(smooth_image(40, 60), path)
    path.write_bytes(path.read_bytes()[:-2])
    with pytest.raises(InputError, match=r"a\.jpg: damaged; delete it"):
        read_written(path)
