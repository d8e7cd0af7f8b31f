"""What the words of the command line name."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from shaftpose.core.errors import InputError
from shaftpose.core.images import write_jpeg
from shaftpose.inference.image_files import ImageFile
from shaftpose.inference.live_streams import LiveStream
from shaftpose.inference.sources import sources
from shaftpose.inference.video_files import VideoFile


def test_names_are_told_apart(tmp_path: Path) -> None:
    for name in ("b.PNG", "a.jpg", "notes.txt"):
        (tmp_path / name).touch()
    (tmp_path / "deeper").mkdir()
    (tmp_path / "deeper/c.png").touch()
    names = ["x.tif", str(tmp_path), "clip.mp4", "0", "rtsp://host/live", "./0"]
    assert list(sources(names, [])) == [
        ImageFile(Path("x.tif")), ImageFile(tmp_path / "a.jpg"), ImageFile(tmp_path / "b.PNG"),
        VideoFile(Path("clip.mp4")), LiveStream(0), LiveStream("rtsp://host/live"),
        VideoFile(Path("0")),
    ]  # fmt: skip


def test_a_dash_stands_for_lines_which_are_read_in_their_turn() -> None:
    read: list[str] = []

    def lines() -> Iterator[str]:
        for line in ("a b.png\n", "\n", "c.avi\r\n"):
            read.append(line)
            yield line

    found = sources(["first.png", "-", "last.png"], lines())
    assert next(found) == ImageFile(Path("first.png"))
    assert next(found) == ImageFile(Path("a b.png"))
    assert read == ["a b.png\n"]
    assert list(found) == [VideoFile(Path("c.avi")), ImageFile(Path("last.png"))]


def test_a_folder_without_images_says_so_in_its_turn(tmp_path: Path) -> None:
    (folder,) = sources([str(tmp_path)], [])
    with pytest.raises(InputError, match=f"^{tmp_path}: holds no image; images end in .bmp, "):
        list(folder.frames())


def test_an_image_is_one_frame(tmp_path: Path) -> None:
    path = tmp_path / "a.jpg"
    write_jpeg(np.full((20, 30, 3), 90, dtype=np.uint8), path)
    (frame,) = ImageFile(path).frames()
    assert (frame.source, frame.number, frame.fps) == (str(path), 0, None)
    assert frame.rgb.shape == (20, 30, 3)
