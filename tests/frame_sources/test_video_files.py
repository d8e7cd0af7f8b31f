"""Videos as sources of frames."""

import re
import struct
from pathlib import Path
from unittest.mock import Mock

import cv2
import numpy as np
import pytest

from shaftpose.core.errors import InputError
from shaftpose.frame_sources.film_clock import FilmClock
from shaftpose.frame_sources.video_files import Span, VideoFile, frame_rate
from tests.frame_sources.videos import (
    TRACK,
    edit_box,
    with_pixel_aspect,
    write_matroska,
    write_video,
)


def fail(message: str) -> None:
    raise AssertionError(message)


def test_all_frames_come_in_their_order(tmp_path: Path) -> None:
    video = VideoFile(write_video(tmp_path / "clip.avi", [40, 120, 200]))
    assert video.length == 3
    frames = list(video.frames())
    assert [frame.number for frame in frames] == [0, 1, 2]
    assert [frame.rgb.mean() for frame in frames] == pytest.approx([40, 120, 200], abs=2)
    assert [frame.time_s for frame in frames] == pytest.approx([0, 0.1, 0.2])
    assert {(frame.source, frame.fps) for frame in frames} == {(str(video.path), 10.0)}
    assert frames[0].rgb.shape == (48, 64, 3)


@pytest.mark.parametrize(
    ("stated", "used"),
    [
        (0.0, 25),
        (float("nan"), 25),
        (29.97, 29.97),
        (1000.0, 25),
        (90_000.0, 25),
        (480, 480),
        (0.5, 0.5),
    ],
)
def test_ticks_are_no_frames_a_second(stated: float, used: float) -> None:
    capture = Mock(get=Mock(return_value=stated))
    assert frame_rate(capture) == used


def test_a_video_that_is_cut_keeps_its_frames(tmp_path: Path) -> None:
    path = write_video(tmp_path / "clip.avi", [40] * 60)
    for share, least in ((0.5, 10), (0.93, 50)):
        part = tmp_path / f"{share}.avi"
        part.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
        read = []
        with pytest.raises(InputError, match=f"^{part}: is cut short; only its first \\d+ frames"):
            read.extend(frame.number for frame in VideoFile(part).frames(fail))
        assert least < len(read) < 60


def test_a_video_whose_frames_are_damaged_ends_early(tmp_path: Path) -> None:
    path = write_video(tmp_path / "clip.avi", [40] * 60)
    size = path.stat().st_size
    with path.open("r+b") as file:
        file.seek(size // 3)
        file.write(bytes(size // 2))
    with pytest.raises(InputError, match=f"^{path}: ends after \\d+ of 60 frames"):
        list(VideoFile(path).frames(fail))


def test_a_video_of_which_no_frame_can_be_decoded_is_named(tmp_path: Path) -> None:
    path = write_video(tmp_path / "clip.avi", [40] * 3)
    before, frames, index = re.split(b"(?<=movi)(.*)(?=idx1)", path.read_bytes(), flags=re.DOTALL)
    path.write_bytes(before + bytes(len(frames)) + index)
    with pytest.raises(InputError, match=f"^{path}: OpenCV cannot decode its frames; convert it"):
        list(VideoFile(path).frames(fail))


@pytest.mark.parametrize("times_ms", [[0, 40, 1000, 3000], [0, 40, 80, 3000]])
def test_frames_of_changing_rates_have_their_own_times(times_ms: list[int], tmp_path: Path) -> None:
    """OpenCV estimates 38 frames or more from the length of 3.04 s."""
    path = write_matroska(tmp_path / "clip.mkv", [40, 80, 120, 200], times_ms, 3040)
    frames = list(VideoFile(path).frames(fail))
    assert [frame.time_s for frame in frames] == [time / 1000 for time in times_ms]
    assert frames[3].rgb.mean() == pytest.approx(200, abs=2)


def test_joined_files_of_a_recorder_follow_each_other(tmp_path: Path) -> None:
    """The times of each begin again in an MPEG program stream."""
    part = write_video(tmp_path / "part.mpg", [40] * 50).read_bytes()
    path = tmp_path / "joined.mpg"
    path.write_bytes(part + part)
    times = [frame.time_s for frame in VideoFile(path).frames(fail)]
    assert times == pytest.approx([n / 25 for n in range(100)])


def test_times_that_step_back_or_are_missing_are_filled() -> None:
    clock = FilmClock(fps=10)
    stated = [0.1, 0.3, 0.2, 0, 0.5, 5, 0, 1.2, 1.3, float("inf")]
    assert [clock.time_s(time) for time in stated] == pytest.approx(
        [0.1, 0.3, 0.3, 0.4, 0.5, 5, 5.1, 5.2, 5.3, 5.4]
    )


def test_a_single_wrong_time_moves_no_other() -> None:
    clock = FilmClock(fps=10)
    stated = [4.9, 5.0, 0.5, 5.2, 5.3, 0.1, 0.2, 0.3]
    assert [clock.time_s(time) for time in stated] == pytest.approx(
        [4.9, 5.0, 5.1, 5.2, 5.3, 5.4, 5.5, 5.6]
    )


def test_the_last_frame_may_be_shown_for_long(tmp_path: Path) -> None:
    path = write_matroska(tmp_path / "clip.mkv", [40, 80, 120], [0, 40, 2000], 3900)
    assert len(list(VideoFile(path).frames(fail))) == 3


def test_a_later_part_of_a_recording_is_complete(tmp_path: Path) -> None:
    """Its times begin at 10 s, and its length is their end."""
    times = [*range(10_000, 10_400, 40)]
    path = write_matroska(tmp_path / "part.mkv", [40] * 10, times, 10_400)
    assert [frame.time_s for frame in VideoFile(path).frames(fail)] == [n / 25 for n in range(10)]
    path = write_matroska(tmp_path / "cut.mkv", [40] * 10, times, 11_000)
    with pytest.raises(InputError, match=f"^{path}: ends after 10 of 25 frames"):
        list(VideoFile(path).frames(fail))


def test_a_trimmed_video_is_complete(tmp_path: Path) -> None:
    """Its header counts 20 frames, of which an edit list shows the second half."""
    path = write_video(tmp_path / "clip.mp4", range(20, 120, 5))
    half = struct.pack(">I", 1000)
    edit_box(path, (b"moov", b"mvhd"), lambda header: header[:16] + half + header[20:])
    start = half + struct.pack(">I", 10 * 1024)
    edit_box(path, (*TRACK, b"edts", b"elst"), lambda edits: edits[:8] + start + edits[16:])
    assert len(list(VideoFile(path).frames(fail))) == 10


def test_single_missing_frames_are_told(tmp_path: Path) -> None:
    """The header is made to count two frames more than there are."""
    path = write_video(tmp_path / "clip.avi", [40] * 60)
    data, sixty = path.read_bytes(), struct.pack("<I", 60)
    path.write_bytes(data.replace(sixty, struct.pack("<I", 62)))
    warnings: list[str] = []
    assert len(list(VideoFile(path).frames(warnings.append))) == 60
    assert warnings == [f"{path}: 2 of its 62 frames are missing"]


EVERY_40_MS = [*range(0, 800, 40)]
GAP = "has no frames between 0.08 and 0.20 s"


@pytest.mark.parametrize(
    ("missing", "span", "warning"),
    [
        ([], Span(), ""),
        ([3, 4], Span(), f"{GAP}; it may be damaged there"),
        ([3, 4], Span(end_s=0.4), f"{GAP}; it may be damaged there"),
        ([3, 4], Span(end_s=0.1), ""),
        ([3, 4, 7, 12], Span(), f"{GAP}, nor in 2 other gaps; it may be damaged there"),
        ([3, 5, 7, 9, 11], Span(), ""),  # the rate varies
    ],
)
def test_gaps_between_times_are_told(
    missing: list[int], span: Span, warning: str, tmp_path: Path
) -> None:
    """Matroska states no number of frames."""
    times = [time for number, time in enumerate(EVERY_40_MS) if number not in missing]
    path = write_matroska(tmp_path / "clip.mkv", [40] * len(times), times, 800)
    warnings: list[str] = []
    list(VideoFile(path, span).frames(warnings.append))
    assert warnings == ([f"{path}: {warning}"] if warning else [])


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (None, "no such file"),
        (b"", "an empty file"),
        (b"no video", "neither an image nor a video .* DICOM"),
    ],
)
def test_what_is_no_video_is_named(content: bytes | None, problem: str, tmp_path: Path) -> None:
    path = tmp_path / "clip.mp4"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=f"^{path}: {problem}"):
        list(VideoFile(path).frames())
    assert VideoFile(path).length is None


@pytest.mark.parametrize("name", ["2026-11-27T10:30:00.avi", "http:a.avi", "concat:a.avi"])
def test_a_name_is_no_address(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write_video(tmp_path / name, [40, 80])
    video = VideoFile(Path(name))
    assert (video.length, len(list(video.frames()))) == (2, 2)


def test_a_name_at_which_opencv_crashes_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "caf\udce9.mp4"
    path.write_bytes(b"no video")
    with pytest.raises(InputError, match=r"a video's name must be UTF-8; rename it$"):
        list(VideoFile(path).frames())
    assert VideoFile(path).length is None


@pytest.mark.parametrize(("width", "height"), [(64, 45), (8, 9), (1, 1)])
def test_the_shape_of_pixels_is_told(width: int, height: int, tmp_path: Path) -> None:
    video = with_pixel_aspect(write_video(tmp_path / "clip.mp4", [40]), width, height)
    (frame,) = VideoFile(video).frames(fail)
    assert frame.aspect == pytest.approx(width / height)
    assert frame.rgb.shape == (48, 64, 3)


def set_matrix(video: Path, turn: tuple[int, int, int, int], across: int) -> None:
    xx, xy, yx, yy = (number << 16 for number in turn)
    matrix = struct.pack(">9i", xx, xy, 0, yx, yy, 0, across << 16, 0, 1 << 30)
    edit_box(video, (*TRACK, b"tkhd"), lambda header: header[:40] + matrix + header[76:])


@pytest.mark.parametrize("turn", [(-1, 0, 0, 1), (0, 1, 1, 0)])
def test_a_film_that_asks_to_be_mirrored_is_refused(
    turn: tuple[int, int, int, int], tmp_path: Path
) -> None:
    video = write_video(tmp_path / "clip.mp4", [40])
    set_matrix(video, turn, 64)
    with pytest.raises(InputError, match=f"^{video}: asks for a mirrored picture"):
        list(VideoFile(video).frames(fail))


def test_pixels_turn_with_their_frame(tmp_path: Path) -> None:
    """The track's header holds a matrix of 16.16 numbers that turns frames by 90 deg."""
    video = with_pixel_aspect(write_video(tmp_path / "clip.mp4", [40]), 4, 3)
    set_matrix(video, (0, 1, -1, 0), 48)
    (frame,) = VideoFile(video).frames(fail)
    assert frame.rgb.shape == (64, 48, 3)
    assert frame.aspect == pytest.approx(3 / 4)


def test_pixels_of_a_meaningless_shape_are_named(tmp_path: Path) -> None:
    video = with_pixel_aspect(write_video(tmp_path / "clip.mp4", [40]), 500, 1)
    with pytest.raises(InputError, match=f"^{video}: states pixels of 500 : 1"):
        list(VideoFile(video).frames(fail))


def test_giant_frames_are_refused_by_the_size_that_they_state(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OPENCV_IO_MAX_IMAGE_PIXELS", "3000")
    video = write_video(tmp_path / "clip.avi", [40])
    with pytest.raises(InputError, match=f"^{video}: has frames of 64 x 48 px; scale it down"):
        list(VideoFile(video).frames(fail))


def test_the_most_pixels_may_have_a_unit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    video = write_video(tmp_path / "clip.avi", [40])  # of 3,072 px
    for value in ("3KB", "3kb", "1MB", "3072"):
        monkeypatch.setenv("OPENCV_IO_MAX_IMAGE_PIXELS", value)
        assert len(list(VideoFile(video).frames(fail))) == 1
    monkeypatch.setenv("OPENCV_IO_MAX_IMAGE_PIXELS", "2kb")
    with pytest.raises(InputError, match="64 x 48 px; scale it down"):
        list(VideoFile(video).frames(fail))


def test_a_video_of_black_frames_alone_is_named(tmp_path: Path) -> None:
    video = write_video(tmp_path / "clip.avi", [0, 0, 0])
    with pytest.raises(InputError, match=f"^{video}: all its frames are black; if it is interl"):
        list(VideoFile(video).frames(fail))
    assert len(list(VideoFile(write_video(tmp_path / "fade.avi", [0, 0, 9])).frames(fail))) == 3


def test_a_still_picture_is_a_video(tmp_path: Path) -> None:
    assert len(list(VideoFile(write_video(tmp_path / "still.avi", [90] * 4)).frames(fail))) == 4


class Unwritten:
    """A capture of eight frames, the first two alike, that from some frame on returns what its
    memory holds, as OpenCV does of interlaced video."""

    first = 0

    def __init__(self, name: str) -> None:
        self._memory = np.random.default_rng(id(self)).integers(0, 255, (48, 64, 3), np.uint8)
        self._count = 0

    def set(self, name: int, value: float) -> bool:
        return True

    def isOpened(self) -> bool:  # noqa: N802
        return True

    def get(self, name: int) -> float:
        return {cv2.CAP_PROP_FRAME_COUNT: 8.0, cv2.CAP_PROP_FPS: 25.0}.get(name, 0.0)

    def grab(self) -> bool:
        self._count += 1
        return self._count <= 8

    def retrieve(self) -> tuple[bool, np.ndarray]:
        if self._count <= self.first:
            self._memory = np.full((48, 64, 3), 20 * max(self._count, 2), np.uint8)
        return True, self._memory.copy()

    def read(self) -> tuple[bool, np.ndarray | None]:
        return self.retrieve() if self.grab() else (False, None)


@pytest.mark.parametrize("first", [0, 2, 5])
def test_frames_that_opencv_does_not_write_are_named(
    first: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    video = write_video(tmp_path / "clip.avi", [40])
    monkeypatch.setattr(Unwritten, "first", first)
    monkeypatch.setattr(cv2, "VideoCapture", Unwritten)
    read = []
    with pytest.raises(InputError, match=f"^{video}: frame {first} cannot be decoded; if it is in"):
        read.extend(frame.number for frame in VideoFile(video).frames(fail))


@pytest.mark.parametrize(
    ("span", "first", "numbers"),
    [
        (Span(start_s=0.35), 0, [4, 5, 6, 7, 8, 9]),
        (Span(end_s=0.3), 0, [0, 1, 2]),
        (Span(every=4), 0, [0, 4, 8]),
        (Span(0.2, 0.7, 3), 0, [3, 6]),
        (Span(0.2, 0.7, 3), 4, [6]),
        (Span(), 8, [8, 9]),
        (Span(), 10, []),
    ],
)
def test_a_part_of_a_video_keeps_its_numbers_and_times(
    span: Span, first: int, numbers: list[int], tmp_path: Path
) -> None:
    path = write_video(tmp_path / "clip.avi", range(20, 220, 20))
    frames = list(VideoFile(path, span, first).frames(fail))
    assert [frame.number for frame in frames] == numbers
    for frame in frames:
        assert frame.time_s == pytest.approx(frame.number / 10)
        assert frame.rgb.mean() == pytest.approx(20 * (frame.number + 1), abs=3)
        assert frame.fps == 10 / span.every


def test_a_start_after_the_end_is_named(tmp_path: Path) -> None:
    path = write_video(tmp_path / "clip.avi", [40] * 10)
    with pytest.raises(InputError, match=f"^{path}: ends after 1.00 s, before --start"):
        list(VideoFile(path, Span(start_s=5)).frames(fail))
