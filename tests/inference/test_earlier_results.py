"""Results of an interrupted run."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from shaftpose.core.errors import InputError
from shaftpose.core.geometry import ShaftPose
from shaftpose.frame_sources.frames import Frame, ImageFile
from shaftpose.frame_sources.live_streams import LiveStream
from shaftpose.frame_sources.video_files import VideoFile
from shaftpose.inference.earlier_results import Earlier, continued
from shaftpose.inference.formats import format_of_run
from shaftpose.inference.found_shafts import FoundShaft
from shaftpose.inference.result_stream import UnwritableError, hold

RGB = np.zeros((4, 4, 3), dtype=np.uint8)
SHAFT = FoundShaft(
    0.9, np.zeros(4), np.zeros((2, 2)), ShaftPose(1, 2, 20, 90, 0), True, "seen"
)  # fmt: skip
IMAGES = [Frame(name, 0, RGB) for name in ("f/a.png", "f/b\r\n.png", "caf\udce9.png", "=1.png")]
FILM = [Frame("film.mp4", number, RGB, number / 25) for number in range(3)]


def written(folder: Path, style: str, frames: list[Frame]) -> Path:
    """A file with two shafts in each frame."""
    path, form = folder / f"predictions.{style}", format_of_run(style)
    text = form.header + "".join(form.lines(frame, [SHAFT, SHAFT]) for frame in frames)
    path.write_bytes(text.encode(errors="surrogateescape"))
    return path


@pytest.mark.parametrize("style", ["jsonl", "csv"])
def test_the_last_frame_is_dropped(style: str, tmp_path: Path) -> None:
    before = written(tmp_path, style, [*IMAGES, *FILM[:2]]).read_bytes()
    path = written(tmp_path, style, [*IMAGES, *FILM])
    with path.open("ab") as file:
        file.write(b"half a line")
    earlier = continued(path, style, tracked=False, drawn=False)
    assert earlier.frames == {**{image.source: [1] for image in IMAGES}, "film.mp4": [2]}
    assert earlier.count == len(IMAGES) + 2
    assert earlier.again == {"film.mp4"}
    assert path.read_bytes() == before


@pytest.mark.parametrize("style", ["jsonl", "csv"])
@pytest.mark.parametrize(
    ("frames", "tracked", "drawn", "kept"),
    [
        ([*IMAGES, *FILM], False, True, 4),
        ([*IMAGES, *FILM], True, False, 4),
        ([*FILM, *IMAGES[:2]], False, True, 4),
        ([*FILM, *IMAGES[:2]], True, False, 3),
        ([*FILM, *IMAGES], True, False, 5),
        (IMAGES[:1], False, False, 0),
        ([], True, True, 0),
    ],
)
def test_a_film_is_dropped_as_a_whole_if_it_must_be(
    style: str, frames: list[Frame], tracked: bool, drawn: bool, kept: int, tmp_path: Path
) -> None:
    before = written(tmp_path, style, frames[:kept]).read_bytes() if kept or frames else b""
    path = written(tmp_path, style, frames)
    earlier = continued(path, style, tracked, drawn)
    assert earlier.frames == {frame.source: [frame.number + 1] for frame in frames[:kept]}
    assert earlier.again == {frame.source for frame in frames[kept:]}
    assert path.read_bytes() == before


def test_what_is_left_is_predicted() -> None:
    done = Earlier({"a.png": [1], "film.mp4": [7], "camera 0": [9]})
    named = [
        ImageFile(Path("a.png")), ImageFile(Path("b.png")), VideoFile(Path("film.mp4")),
        VideoFile(Path("new.mp4")), LiveStream(0),
    ]  # fmt: skip
    assert list(done.rest(named)) == [
        named[1], VideoFile(Path("film.mp4"), first=7), named[3], named[4],
    ]  # fmt: skip


def test_a_source_that_is_named_twice_is_done_twice(tmp_path: Path) -> None:
    path = written(tmp_path, "jsonl", [*FILM, IMAGES[0], IMAGES[0], *FILM[:2]])
    earlier = continued(path, "jsonl", tracked=False, drawn=False)
    assert earlier.frames == {"film.mp4": [3, 1], "f/a.png": [1, 1]}
    film, image = VideoFile(Path("film.mp4")), ImageFile(Path("f/a.png"))
    left = list(earlier.rest([film, image, image, film, image]))
    assert left == [replace(film, first=3), replace(film, first=1), image]


@pytest.mark.parametrize("style", ["jsonl", "csv"])
@pytest.mark.parametrize("foreign", ["checked by hand", '"' + 200_000 * "?"])
def test_a_foreign_line_is_named_by_its_place(style: str, foreign: str, tmp_path: Path) -> None:
    path = written(tmp_path, style, FILM)
    rows = path.read_text().splitlines(keepends=True)
    path.write_text("".join([*rows[:-1], f"{foreign}\n", rows[-1]]))
    before = path.read_bytes()
    frames = 2 if style == "jsonl" else 3  # a table has a row for each of the two shafts
    message = f"^{path}: after {frames} frames, holds no results of --format {style}; remove it"
    with pytest.raises(InputError, match=message):
        continued(path, style, tracked=False, drawn=False)
    assert path.read_bytes() == before


def test_a_table_of_another_form_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "predictions.csv"
    path.write_text("scene_id,im_id,obj_id,score,R,t,time\n0,1,1,0.9,1 0,1 2,-1\n")
    before = path.read_bytes()
    with pytest.raises(InputError, match=f"^{path}: holds no results of --format csv; remove it"):
        continued(path, "csv", tracked=False, drawn=False)
    assert path.read_bytes() == before


def test_results_that_another_run_writes_are_left_alone(tmp_path: Path) -> None:
    path = written(tmp_path, "jsonl", FILM)
    before = path.read_bytes()
    with path.open("a") as other:
        hold(other, path)
        with pytest.raises(UnwritableError, match=f"^{path}: another run is writing to this file"):
            continued(path, "jsonl", tracked=False, drawn=False)
    assert path.read_bytes() == before
    assert continued(path, "jsonl", tracked=False, drawn=False).frames == {"film.mp4": [2]}


def test_what_is_no_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(UnwritableError, match=f"^{tmp_path}: cannot be written"):
        continued(tmp_path, "jsonl", tracked=False, drawn=False)
