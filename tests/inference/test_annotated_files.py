"""Pictures and videos of results."""

import os
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import cv2
import numpy as np
import pytest

from shaftpose.core.errors import InputError
from shaftpose.core.geometry import ShaftPose
from shaftpose.core.images import Image
from shaftpose.frame_sources.frames import Frame
from shaftpose.inference.annotated_files import annotated_files, codec, draw_shafts, unused
from shaftpose.inference.found_shafts import FoundShaft
from shaftpose.inference.result_stream import UnwritableError
from tests.frame_sources.videos import read_greys
from tests.inference.full_disk import longest_file

AXIS = np.array([[200.0, 100.0], [260.0, 100.0]])
SHAFT = FoundShaft(
    0.9, np.array([50.0, 60, 300, 160]), AXIS, ShaftPose(1, 2, 20, 90, 0), True, "seen"
)


def grey(value: int, width: int = 400, height: int = 300) -> Image:
    return np.full((height, width, 3), value, dtype=np.uint8)


def film_frame(source: str, number: int, rgb: Image, fps: float = 10.0) -> Frame:
    return Frame(source, number, rgb, number / fps, fps)


def test_box_tip_axis_and_pose_are_drawn() -> None:
    black = grey(0)
    drawn = draw_shafts(black, [SHAFT]).max(axis=2)
    for x, y in ((50, 100), (299, 100), (100, 60), (100, 159), (197, 100), (240, 100)):
        assert drawn[y - 1 : y + 2, x - 1 : x + 2].max() > 100
    assert drawn[280:, :200].max() > 100
    assert drawn[65:95, 55:180].max() == drawn[100, 270:290].max() == drawn[200:270].max() == 0
    assert not black.any()


def test_a_frame_without_shafts_stays_as_it_is() -> None:
    np.testing.assert_array_equal(draw_shafts(grey(7), []), grey(7))


def test_poses_that_are_not_metric_are_marked() -> None:
    shaft = FoundShaft(**{**vars(SHAFT), "metric": False})
    widths = [np.flatnonzero(draw_shafts(grey(0), [s])[270:].any(axis=(0, 2))).max()
              for s in (SHAFT, shaft)]  # fmt: skip
    assert widths[1] > widths[0] + 40


def test_a_tip_that_is_not_seen_has_a_hollow_mark() -> None:
    for tip, filled in (("seen", True), ("hidden", False), ("outside", False)):
        drawn = draw_shafts(grey(0, 1200, 900), [replace(SHAFT, tip=tip)])
        # Just behind the tip, next to the axis and inside of the mark.
        assert bool(drawn[104, 197].any()) == filled


@pytest.mark.parametrize("tip", [(200.0, 100.0), (-50.0, -50.0), (900.0, 900.0)])
def test_each_shaft_has_its_number_at_its_tip(tip: tuple[float, float]) -> None:
    axis = np.array([tip, tip])
    shafts = [replace(SHAFT, axis_px=axis, track=number) for number in (1, 12)]
    first, second = (draw_shafts(grey(0), [shaft]).max(axis=2) for shaft in shafts)
    x, y = np.clip(tip, (2, 14), (396, 296)).astype(int)
    near = slice(max(y - 20, 0), y + 1), slice(max(x - 12, 0), x + 24)
    assert (first[near] != second[near]).any()
    number_and_pose = first != second
    number_and_pose[near] = False
    assert not number_and_pose[:270].any()


def test_a_name_that_is_too_long_for_a_drawing_is_named(tmp_path: Path) -> None:
    """A name has at most 255 bytes."""
    with annotated_files(tmp_path) as files:
        files.add(Frame(f"{'a' * 250}.png", 0, grey(40)), [])
        for frame in (Frame("a" * 255, 0, grey(40)), film_frame("é" * 126 + ".avi", 0, grey(40))):
            with pytest.raises(InputError, match=r"^no drawing: .* is too long for a name") as said:
                files.add(frame, [])
            assert not isinstance(said.value, UnwritableError)
    assert [path.name for path in tmp_path.iterdir()] == [f"{'a' * 250}.jpg"]


def test_lines_grow_with_the_frame() -> None:
    wide = draw_shafts(grey(0, 1600, 1200), [SHAFT])[110, 30:70].any(axis=1).sum()
    assert wide >= draw_shafts(grey(0), [SHAFT])[110, 30:70].any(axis=1).sum() + 2


def test_each_image_gets_a_picture_of_its_own(tmp_path: Path) -> None:
    with annotated_files(tmp_path) as files:
        for name in ("a/frame.png", "b/frame.jpg", "other.png"):
            files.add(Frame(name, 0, grey(90)), [SHAFT])
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "frame-2.jpg", "frame.jpg", "other.jpg",
    ]  # fmt: skip
    picture = cv2.imread(str(tmp_path / "frame-2.jpg"))
    assert picture.shape == (300, 400, 3) and np.ptp(picture) > 100


def test_a_video_is_complete_before_the_next_results_are_written(tmp_path: Path) -> None:
    with annotated_files(tmp_path) as files:
        for number in range(3):
            files.end_before(film_frame("clip.avi", number, grey(40)), [])
            files.add(film_frame("clip.avi", number, grey(40)), [])
        files.end_before(Frame("photo.png", 0, grey(90)), [])
        assert len(read_greys(tmp_path / "clip.mp4")) == 3


def test_videos_are_written_one_after_the_other(tmp_path: Path) -> None:
    with annotated_files(tmp_path) as files:
        for source, values in (("x/clip.avi", (40, 120, 200)), ("y/clip.avi", (90,)),
                               ("rtsp://host/live", (60, 70))):  # fmt: skip
            for number, value in enumerate(values):
                files.add(film_frame(source, number, grey(value)), [])
    assert read_greys(tmp_path / "clip.mp4") == pytest.approx([40, 120, 200], abs=3)
    assert read_greys(tmp_path / "clip-2.mp4") == pytest.approx([90], abs=3)
    assert read_greys(tmp_path / "stream.mp4") == pytest.approx([60, 70], abs=3)
    assert cv2.VideoCapture(str(tmp_path / "clip.mp4")).get(cv2.CAP_PROP_FPS) == 10


def test_another_size_begins_another_video(tmp_path: Path) -> None:
    with annotated_files(tmp_path) as files:
        files.add(film_frame("clip.avi", 0, grey(40)), [])
        files.add(film_frame("clip.avi", 1, grey(80, 200, 100)), [])
        files.add(film_frame("clip.avi", 2, grey(90, 200, 100)), [])
    assert read_greys(tmp_path / "clip.mp4") == pytest.approx([40], abs=3)
    assert read_greys(tmp_path / "clip-2.mp4") == pytest.approx([80, 90], abs=3)


def test_a_frame_is_drawn_until_the_time_of_the_next(tmp_path: Path) -> None:
    """A gap of 10 s and more is left out."""
    times_s = (0.0, 0.1, 0.5, 0.5, 60.0, 60.1)
    with annotated_files(tmp_path) as files:
        for number, time_s in enumerate(times_s):
            files.add(Frame("clip.avi", number, grey(40 * number), time_s, 10.0), [])
    expected = [0, 40, 40, 40, 40, 80, 120, 160, 200]
    assert read_greys(tmp_path / "clip.mp4") == pytest.approx(expected, abs=3)


@pytest.mark.parametrize("fps", [700.0, 480.0, 0.5, 211.222, 239.999, 1.0, 23.976, 60000 / 1001])
def test_all_rates_of_videos_can_be_written(tmp_path: Path, fps: float) -> None:
    """The fraction that OpenCV makes of 211.222 has a numerator that MPEG-4 refuses."""
    with annotated_files(tmp_path) as files:
        for number in range(2):
            files.add(film_frame("clip.avi", number, grey(40), fps), [])
    written = cv2.VideoCapture(str(tmp_path / "clip.mp4")).get(cv2.CAP_PROP_FPS)
    assert written == pytest.approx(fps, abs=0.003)


def test_a_video_that_does_not_fit_is_named(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (300, 400, 3), dtype=np.uint8)
    with (
        pytest.raises(UnwritableError, match=r"clip\.mp4: not complete"),
        longest_file(10_000),
        annotated_files(tmp_path) as files,
    ):
        for number in range(3):
            files.add(film_frame("clip.avi", number, noise), [])


def test_an_incomplete_video_does_not_hide_what_ended_prediction(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (300, 400, 3), dtype=np.uint8)
    with (
        pytest.raises(UnwritableError, match=r"^predictions\.jsonl"),
        longest_file(10_000),
        annotated_files(tmp_path) as files,
    ):
        for number in range(3):
            files.add(film_frame("clip.avi", number, noise), [])
        raise UnwritableError("predictions.jsonl: cannot be written")


def test_a_video_that_was_begun_is_finished_if_prediction_fails(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), annotated_files(tmp_path) as files:
        files.add(film_frame("clip.avi", 0, grey(40)), [])
        raise KeyboardInterrupt
    assert len(read_greys(tmp_path / "clip.mp4")) == 1


def test_a_folder_that_takes_no_file_is_named(tmp_path: Path) -> None:
    folder = tmp_path / "file"
    folder.touch()
    for time_s in (None, 0.0):
        with (
            pytest.raises(UnwritableError, match=f"^{folder}.*; name another folder by --out"),
            annotated_files(folder) as files,
        ):
            files.add(Frame("a.png", 0, grey(40), time_s), [])


def test_a_folder_whose_name_opencv_cannot_take_is_named(tmp_path: Path) -> None:
    with (
        pytest.raises(UnwritableError, match=r"clip\.mp4: not UTF-8"),
        annotated_files(tmp_path / "caf\udce9") as files,
    ):
        files.add(film_frame("clip.avi", 0, grey(40)), [])


def test_a_file_of_the_user_is_left_alone(tmp_path: Path) -> None:
    """A link to a device, and what looks like an unfinished copy."""
    (tmp_path / "a.jpg").symlink_to("/dev/null")
    (tmp_path / "a-2.jpg.part").write_text("mine")
    with annotated_files(tmp_path) as files:
        files.add(Frame("a.png", 0, grey(40)), [])
    assert (tmp_path / "a-2.jpg").stat().st_size > 1000
    assert (tmp_path / "a-2.jpg.part").read_text() == "mine"


def test_no_file_is_overwritten(tmp_path: Path) -> None:
    assert unused(tmp_path, "a", "jpg") == (tmp_path / "a.jpg", None)
    for name in ("a.jpg", "a-2.jpg"):
        (tmp_path / name).touch()
    assert unused(tmp_path, "a", "jpg") == (tmp_path / "a-3.jpg", tmp_path / "a-2.jpg")


def test_a_film_with_a_colon_in_its_name_is_drawn_into_this_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with annotated_files(Path()) as files:
        files.add(film_frame("10:30:00.avi", 0, grey(40)), [])
    assert len(read_greys(tmp_path / "10:30:00.mp4")) == 1


def test_the_search_for_a_codec_writes_no_errors(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """FFmpeg complains of missing devices, past OpenCV's log."""

    def writer(*arguments: object) -> Mock:
        os.write(2, b"Could not find a valid device")
        return Mock(isOpened=lambda: False)

    monkeypatch.setattr(cv2, "VideoWriter", Mock(side_effect=writer, fourcc=Mock()))
    codec.cache_clear()
    assert codec() == "mp4v"
    codec.cache_clear()
    os.write(2, b"afterwards")
    assert capfd.readouterr().err == "afterwards"
