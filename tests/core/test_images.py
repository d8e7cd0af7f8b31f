"""Decoding, encoding and cropping of images."""

import os
import subprocess
import sys
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from shaftpose.core.errors import InputError
from shaftpose.core.images import centre_square, decode_rgb, encode_jpeg, read_rgb, write_jpeg


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


def complaint(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        read_rgb(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    return message


def test_a_file_that_is_no_image_is_named(tmp_path: Path) -> None:
    broken = tmp_path / "broken.jpg"
    broken.write_bytes(b"not a picture")
    assert "not a readable image" in complaint(broken)


def test_missing_files_and_folders_are_named(tmp_path: Path) -> None:
    assert "No such file" in complaint(tmp_path / "missing.png")
    assert "Is a directory" in complaint(tmp_path)
    assert "null" in complaint(tmp_path / "a\0b.png")


def test_a_file_that_may_not_be_read_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(path: Path) -> bytes:
        raise PermissionError(13, "Permission denied", str(path))

    # root can read any file, so its mode has no effect.
    monkeypatch.setattr(Path, "read_bytes", refuse)
    secret = tmp_path / "secret.jpg"
    secret.touch()
    assert "Permission denied" in complaint(secret)


def test_what_never_ends_is_not_read(tmp_path: Path) -> None:
    pipe, device, large = tmp_path / "pipe.png", tmp_path / "zero.png", tmp_path / "large.png"
    os.mkfifo(pipe)
    device.symlink_to("/dev/zero")
    with large.open("wb") as file:
        file.truncate(2**30 + 1)
    assert "a pipe or a device" in complaint(pipe)
    assert "a pipe or a device" in complaint(device)
    assert "larger than 1,073,741,824 bytes" in complaint(large)


READ = """
import sys
from pathlib import Path
from shaftpose.core.images import read_rgb
from shaftpose.core.errors import InputError
try:
    read_rgb(Path(sys.argv[1]))
except InputError as error:
    print(error)
"""


def test_a_bomb_is_refused_by_the_size_that_it_states(tmp_path: Path) -> None:
    """A picture of one colour, 11,000 x 10,000 px, compresses to some kB."""
    path = tmp_path / "bomb.png"
    cv2.imwrite(str(path), np.zeros((11_000, 10_000), dtype=np.uint8))
    done = subprocess.run(
        [sys.executable, "-c", READ, str(path)], capture_output=True, text=True, check=True
    )
    assert done.stdout.startswith(f"{path}: states a size beyond 100000000 pixels; scale it down")


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
    back = read_rgb(path)
    assert back.shape == (40, 60, 3)
    # Red and blue differ by up to 195 levels here: swapped channels would show.
    assert np.abs(back.astype(int) - image).mean() < 3
