"""What reads the image files of others, and what it refuses."""

import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from shaftpose.core.errors import InputError
from shaftpose.image_files.reading import read_rgb


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
from shaftpose.image_files.reading import read_rgb
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
