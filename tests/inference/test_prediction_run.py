"""The sources that words name, and the run over all their frames."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from shaftpose.core.errors import InputError, Warn
from shaftpose.core.images import write_jpeg
from shaftpose.frame_sources.frames import Frame, ImageFile
from shaftpose.frame_sources.live_streams import LiveStream
from shaftpose.frame_sources.video_files import Span, VideoFile
from shaftpose.frame_sources.web_addresses import WebAddress
from shaftpose.inference.prediction_run import for_each_frame, sources
from shaftpose.inference.result_stream import UnwritableError


def fail(message: str) -> None:
    raise AssertionError(message)


RGB = np.zeros((4, 4, 3), dtype=np.uint8)


class Clip:
    """Two frames, then perhaps an error."""

    length = 2

    def __init__(self, name: str, breaks: bool = False) -> None:
        self.name, self.breaks = name, breaks

    def frames(self, warn: Warn) -> Iterator[Frame]:
        yield Frame(self.name, 0, RGB)
        yield Frame(self.name, 1, RGB)
        if self.breaks:
            raise InputError(f"{self.name}: ends early")


def test_a_source_that_breaks_does_not_stop_the_others() -> None:
    done: list[tuple[str, int]] = []
    reports: list[str] = []

    def work(frame: Frame) -> None:
        if frame.source == "b":
            raise InputError("of another size")
        done.append((frame.source, frame.number))

    clips = [Clip("a", breaks=True), Clip("b"), Clip("c")]
    assert for_each_frame(clips, work, reports.append, fail) == 2
    assert done == [("a", 0), ("a", 1), ("c", 0), ("c", 1)]
    assert reports == ["a: ends early", "b: of another size"]


def test_results_that_cannot_be_kept_end_it() -> None:
    def work(frame: Frame) -> None:
        raise UnwritableError("disk: full")

    reports: list[str] = []
    with pytest.raises(UnwritableError, match="^disk: full$"):
        for_each_frame([Clip("a")], work, reports.append, fail)
    assert reports == []


def test_names_are_told_apart(tmp_path: Path) -> None:
    for name in ("b.PNG", "a.jpg", "notes.txt"):
        (tmp_path / name).touch()
    (tmp_path / "deeper").mkdir()
    (tmp_path / "deeper/c.png").touch()
    (tmp_path / "d.png").mkdir()
    names = ["x.tif", str(tmp_path), "clip.mp4", "0", "rtsp://host/live", "./0",
             "https://host/clip.mp4", f"file://{tmp_path}/a%20b.mp4", "HTTP://host/a", "FILE:///a",
             "file", "20240131120000"]  # fmt: skip
    assert list(sources(names, [], Span())) == [
        ImageFile(Path("x.tif")), ImageFile(tmp_path / "a.jpg"), ImageFile(tmp_path / "b.PNG"),
        VideoFile(Path("clip.mp4")), LiveStream(0), LiveStream("rtsp://host/live"),
        VideoFile(Path("0")), WebAddress("https://host/clip.mp4"), VideoFile(tmp_path / "a b.mp4"),
        WebAddress("HTTP://host/a"), VideoFile(Path("/a")), VideoFile(Path("file")),
        VideoFile(Path("20240131120000")),
    ]  # fmt: skip


def test_a_dash_stands_for_lines_which_are_read_in_their_turn() -> None:
    read: list[str] = []

    def lines() -> Iterator[str]:
        for line in ("a b.png\n", "\n", "c.avi\r\n"):
            read.append(line)
            yield line

    found = sources(["first.png", "-", "last.png"], lines(), Span())
    assert next(found) == ImageFile(Path("first.png"))
    assert next(found) == ImageFile(Path("a b.png"))
    assert read == ["a b.png\n"]
    assert list(found) == [VideoFile(Path("c.avi")), ImageFile(Path("last.png"))]


def test_a_folder_without_images_says_so_in_its_turn(tmp_path: Path) -> None:
    (folder,) = sources([str(tmp_path)], [], Span())
    with pytest.raises(InputError, match=f"^{tmp_path}: holds no image; name a folder of"):
        list(folder.frames())


def test_films_in_a_folder_are_told(tmp_path: Path) -> None:
    """Pictures that OpenCV reads as films, too, but no others."""
    for name in ("a.png", "b.mp4", "c.GIF", "notes.txt", ".d.avi", "e.mkv.part"):
        (tmp_path / name).touch()
    warnings: list[str] = []
    found = sources([str(tmp_path)], [], Span(), warnings.append)
    assert list(found) == [ImageFile(tmp_path / "a.png")]
    assert warnings == [f"{tmp_path}: its films are left out (2, such as b.mp4); name each film"]


def test_a_part_of_films_is_no_part_of_folders_and_streams(tmp_path: Path) -> None:
    (tmp_path / "a.png").touch()
    warnings: list[str] = []
    found = list(sources([str(tmp_path), "0"], [], Span(every=5), warnings.append))
    assert found == [ImageFile(tmp_path / "a.png"), LiveStream(0)]
    assert warnings == [
        f"{tmp_path}: --start, --end, --every: for films alone; all of its images are used",
        "0: --start, --end, --every: for films alone; they change nothing here",
    ]


def test_a_list_may_begin_with_a_byte_order_mark() -> None:
    assert list(sources(["-"], ["\ufeffa.png\r\n"], Span())) == [ImageFile(Path("a.png"))]


def test_an_image_is_one_frame(tmp_path: Path) -> None:
    path = tmp_path / "a.jpg"
    write_jpeg(np.full((20, 30, 3), 90, dtype=np.uint8), path)
    (frame,) = ImageFile(path).frames()
    assert (frame.source, frame.number, frame.time_s) == (str(path), 0, None)
    assert frame.rgb.shape == (20, 30, 3)
