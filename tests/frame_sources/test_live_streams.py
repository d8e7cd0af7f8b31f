"""Live sources give their newest frame."""

from pathlib import Path
from threading import Event

import cv2
import pytest

from shaftpose.core.errors import InputError
from shaftpose.frame_sources.frames import Frame
from shaftpose.frame_sources.live_streams import LiveStream, NewestFrames
from tests.frame_sources.videos import write_video

PATIENCE_S = 10


class Device:
    """Shows frames "0", "1", ...; waits before `pause` until it is `resumed`, ends before `end`."""

    def __init__(self, pause: int, end: int) -> None:
        self.pause, self.end, self.next = pause, end, 0
        self.paused, self.resumed, self.released = Event(), Event(), Event()

    def read(self) -> tuple[bool, str | None]:
        if self.next == self.pause:
            self.paused.set()
            assert self.resumed.wait(PATIENCE_S)
        if self.next == self.end:
            return False, None
        self.next += 1
        return True, str(self.next - 1)

    def release(self) -> None:
        self.released.set()


def test_a_slow_reader_gets_the_newest_frame() -> None:
    device = Device(pause=50, end=80)
    frames = NewestFrames(device)
    assert device.paused.wait(PATIENCE_S)
    found = iter(frames)
    assert next(found)[::2] == (49, "49")
    device.resumed.set()
    assert device.released.wait(PATIENCE_S)
    ((number, time_s, pixels),) = found
    assert (number, pixels) == (79, "79") and time_s > 0


def test_closing_ends_the_reading() -> None:
    device = Device(pause=5, end=10**9)
    frames = NewestFrames(device)
    device.resumed.set()
    assert next(iter(frames))[2].isdecimal()
    frames.close()
    assert device.released.wait(PATIENCE_S)


def test_a_stream_is_shown_to_its_last_frame_and_its_end_reported(tmp_path: Path) -> None:
    address = f"file://{write_video(tmp_path / 'clip.avi', [40, 120, 200])}"
    frames: list[Frame] = []
    with pytest.raises(InputError, match=f"^{address}: shows no more frames; is it still conn"):
        frames.extend(LiveStream(address).frames())
    assert frames[-1].number == 2
    assert frames[-1].rgb.mean() == pytest.approx(200, abs=2)
    assert all(frame.time_s is not None and 0 <= frame.time_s < PATIENCE_S for frame in frames)
    assert {(frame.source, frame.fps) for frame in frames} == {(address, 10.0)}


def test_a_stream_of_oblong_pixels_states_their_aspect(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    address = f"file://{write_video(tmp_path / 'clip.avi', [40])}"
    opened, stated = cv2.VideoCapture, {cv2.CAP_PROP_SAR_NUM: 64.0, cv2.CAP_PROP_SAR_DEN: 45.0}

    class Oblong:
        def __init__(self, address: str) -> None:
            self._capture = opened(address)

        def get(self, name: int) -> float:
            return stated.get(name, self._capture.get(name))

        def __getattr__(self, name: str) -> object:
            return getattr(self._capture, name)

    monkeypatch.setattr(cv2, "VideoCapture", Oblong)
    assert next(LiveStream(address).frames()).aspect == 64 / 45


def test_a_camera_that_ends_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, opened = write_video(tmp_path / "clip.avi", [40]), cv2.VideoCapture
    monkeypatch.setattr(cv2, "VideoCapture", lambda index: opened(str(path)))
    frames = LiveStream(1).frames()
    assert next(frames).source == "camera 1"
    with pytest.raises(InputError, match="^camera 1: shows no more frames"):
        next(frames)


def test_a_camera_that_is_not_there_is_named() -> None:
    with pytest.raises(InputError, match="^camera 9999: cannot be opened"):
        next(LiveStream(9999).frames())


def test_an_address_that_opencv_cannot_take_is_named() -> None:
    """OpenCV would crash the process."""
    with pytest.raises(InputError, match=r"^rtsp://caf.*must be UTF-8"):
        next(LiveStream("rtsp://caf\udce9/x").frames())
