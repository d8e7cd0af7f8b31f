"""Decoding, encoding and cropping of images."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from shaftpose.errors import InputError
from shaftpose.images import centre_square, decode_rgb, encode_jpeg, read_rgb, write_jpeg


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


def test_png_is_read_as_rgb(tmp_path: Path) -> None:
    # OpenCV writes blue, green, red.
    path = tmp_path / "one.png"
    cv2.imwrite(str(path), np.full((2, 2, 3), (3, 2, 1), dtype=np.uint8))
    np.testing.assert_array_equal(read_rgb(path), np.full((2, 2, 3), (1, 2, 3)))


def test_grey_file_becomes_rgb(tmp_path: Path) -> None:
    path = tmp_path / "grey.png"
    cv2.imwrite(str(path), np.full((2, 2), 9, dtype=np.uint8))
    np.testing.assert_array_equal(read_rgb(path), np.full((2, 2, 3), 9))


def test_unreadable_and_missing_files_are_named(tmp_path: Path) -> None:
    broken = tmp_path / "broken.jpg"
    broken.write_bytes(b"not a picture")
    for path in (broken, tmp_path / "missing.png", tmp_path):
        with pytest.raises(InputError, match="not a readable image") as caught:
            read_rgb(path)
        assert str(caught.value).startswith(f"{path}: ")


def test_jpeg_is_deterministic_and_close_to_the_image(tmp_path: Path) -> None:
    image = smooth_image(40, 60)
    assert encode_jpeg(image, 95) == encode_jpeg(image.copy(), 95)
    assert len(encode_jpeg(image, 30)) < len(encode_jpeg(image, 95))
    path = tmp_path / "new" / "folder" / "a.jpg"
    write_jpeg(image, path)
    back = read_rgb(path)
    assert back.shape == (40, 60, 3)
    # Red and blue differ by up to 195 levels here: swapped channels would show.
    assert np.abs(back.astype(int) - image).mean() < 3
