"""Videos as sources of frames."""

from pathlib import Path
from unittest.mock import Mock

import pytest

from shaftpose.core.errors import InputError
from shaftpose.inference.video_files import VideoFile, frame_rate
from tests.inference.videos import write_video


def test_all_frames_come_in_their_order(tmp_path: Path) -> None:
    video = VideoFile(write_video(tmp_path / "clip.avi", [40, 120, 200]))
    assert video.length == 3
    frames = list(video.frames())
    assert [frame.number for frame in frames] == [0, 1, 2]
    assert [frame.rgb.mean() for frame in frames] == pytest.approx([40, 120, 200], abs=2)
    assert {(frame.source, frame.fps) for frame in frames} == {(str(video.path), 10.0)}
    assert frames[0].rgb.shape == (48, 64, 3)


@pytest.mark.parametrize(
    ("stated", "used"),
    [(0.0, 25), (float("nan"), 25), (29.97, 29.97), (1000.0, 25), (90_000.0, 25)],
)
def test_ticks_are_no_frames_a_second(stated: float, used: float) -> None:
    capture = Mock(get=Mock(return_value=stated))
    assert frame_rate(capture) == used


def test_a_video_that_ends_early_keeps_its_frames(tmp_path: Path) -> None:
    path = write_video(tmp_path / "clip.avi", [40] * 60)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    read = []
    with pytest.raises(InputError, match=f"^{path}: ends after \\d+ of 60 frames"):
        for frame in VideoFile(path).frames():
            read.append(frame.number)
    assert 10 < len(read) < 54


@pytest.mark.parametrize("content", [None, b"", b"no video"])
def test_what_is_no_video_is_named(content: bytes | None, tmp_path: Path) -> None:
    path = tmp_path / "clip.mp4"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=f"^{path}: (no such file|neither an image nor a video)"):
        list(VideoFile(path).frames())
    assert VideoFile(path).length is None


def test_a_name_at_which_opencv_crashes_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "caf\udce9.mp4"
    path.write_bytes(b"no video")
    with pytest.raises(InputError, match=r"a video's name must be UTF-8; rename it$"):
        list(VideoFile(path).frames())
    assert VideoFile(path).length is None
