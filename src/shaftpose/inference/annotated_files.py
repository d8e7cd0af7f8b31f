"""Drawings of found shafts, as pictures and videos in a folder."""

import os
from collections.abc import Iterator, Sequence, Set
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
from cv2.typing import MatLike

from shaftpose.core.errors import InputError
from shaftpose.core.files import output_hidden
from shaftpose.core.images import Image, encode_jpeg
from shaftpose.figures.drawing import (
    FOUND,
    LINE_PX,
    SUBPIXEL_BITS,
    pose_text,
    subpixel_grid,
    write_text,
)
from shaftpose.frame_sources.frames import Frame
from shaftpose.frame_sources.video_files import opencv_takes, stated_length
from shaftpose.inference.found_shafts import FoundShaft
from shaftpose.inference.result_stream import UnwritableError, incomplete, naming_unwritable
from shaftpose.inference.run_record import RunRecord

_LONGEST_GAP_S = 10.0  # between frames of a video, that a drawing keeps
_JPEG_QUALITY, _LONGEST_NAME = 95, 255  # bytes
_H264, _MPEG4 = "avc1", "mp4v"
_PLAIN_PX = 299  # side of a frame with lines of one pixel


def draw_shafts(rgb: Image, shafts: Sequence[FoundShaft]) -> Image:
    """Draw boxes, tips, axes and poses (mm, deg) on a copy of a frame (H, W, 3), with a number for
    each shaft at its tip and its pose.

    The mark of a tip is hollow if the image does not show it. Poses that are not metric say so.
    """
    drawn, scale = rgb.copy(), max(min(rgb.shape[:2]) / _PLAIN_PX, 0.5)
    thickness, bits = max(round(scale), 1), SUBPIXEL_BITS
    for row, shaft in enumerate(sorted(shafts, key=lambda shaft: shaft.track or 0)):
        number = shaft.track or row + 1
        low, high = subpixel_grid(shaft.box.reshape(2, 2)).tolist()
        cv2.rectangle(drawn, low, high, FOUND, thickness, cv2.LINE_AA, bits)
        tip, end = subpixel_grid(shaft.axis_px).tolist()
        cv2.line(drawn, tip, end, FOUND, thickness, cv2.LINE_AA, bits)
        filling = cv2.FILLED if shaft.tip == "seen" else thickness
        cv2.circle(drawn, tip, round(3 * scale) << bits, FOUND, filling, cv2.LINE_AA, bits)
        write_text(drawn, str(number), _beside(shaft, rgb, scale), FOUND, scale)
        place = round(4 * scale), rgb.shape[0] - round((8 + LINE_PX * row) * scale)
        write_text(drawn, f"{number}: {shaft_text(shaft)}", place, FOUND, scale)
    return drawn


def _beside(shaft: FoundShaft, rgb: Image, scale: float) -> tuple[int, int]:
    """The place of a shaft's number: over its tip, within the frame (H, W, 3)."""
    height, width = rgb.shape[:2]
    x, y = shaft.tip_px + [-5 * scale, -7 * scale]
    return int(np.clip(x, 2, width - 12 * scale)), int(np.clip(y, 12 * scale, height - 4))


def shaft_text(shaft: FoundShaft) -> str:
    """The pose (mm, deg) of a shaft; marked if not metric."""
    return pose_text(shaft.pose.as_array()) + ("" if shaft.metric else "  not metric")


class AnnotatedFiles:
    """Writes drawings: a JPEG file for each image, an MP4 file for each video or stream, and a new
    one whenever the size of its frames changes.

    No file is overwritten: a name that exists gets a number. again: sources whose drawings, the
    last ones of an interrupted run, may be incomplete; these are drawn again. record: of the run,
    in which new videos are noted.
    """

    def __init__(self, folder: Path, again: Set[str], record: RunRecord | None) -> None:
        self._folder, self._again, self._record = folder, set(again), record
        videos = () if record is None else record.videos
        self._incomplete = [(name, source) for name, source in videos if source in again]
        self._video: AnnotatedVideo | None = None

    def end_before(self, frame: Frame, _: Sequence[FoundShaft]) -> None:
        """Finish the current video if a frame is not part of it. This comes before the frame's
        results are written, so that results of a next source prove the video complete.

        Raises UnwritableError naming the video if it is not.
        """
        if self._video is not None and not self._video.is_continued_by(frame):
            self.close()

    def add(self, frame: Frame, shafts: Sequence[FoundShaft]) -> None:
        """Draw a frame.

        Raises UnwritableError naming the picture if it cannot be written, the video if it cannot be
        created, or an earlier one that is not complete.
        """
        drawn = draw_shafts(frame.rgb, shafts)
        if frame.time_s is None:
            self._write_picture(frame.source, encode_jpeg(drawn, _JPEG_QUALITY))
        else:
            self._video_of(frame).add(drawn, frame.number, frame.time_s)

    def close(self) -> None:
        """Finish the last video. Raises UnwritableError naming it if it is not complete."""
        if self._video is not None:
            self._video.close()
            self._video = None

    def release(self) -> None:
        """Finish the last video as it is."""
        if self._video is not None:
            self._video.release()

    def _write_picture(self, source: str, data: bytes) -> None:
        path, last = unused(self._folder, Path(source).stem, "jpg")
        with naming_unwritable(path):
            self._folder.mkdir(parents=True, exist_ok=True)
            if source in self._again and last and data.startswith(last.read_bytes()):
                path = last
            path.write_bytes(data)

    def _video_of(self, frame: Frame) -> "AnnotatedVideo":
        """The video that a frame continues, or a new one; of a film that is drawn again, the one
        that was drawn before."""
        if self._video is None or not self._video.is_continued_by(frame):
            self.close()
            path, _ = unused(self._folder, _stem(frame.source), "mp4")
            if drawn := [each for each in self._incomplete if each[1] == frame.source]:
                self._incomplete.remove(drawn[0])
                path = self._folder / drawn[0][0]
            if self._record is not None:
                self._record.add_video(path.name, frame.source)
            self._video = AnnotatedVideo(path, frame)
        return self._video


class AnnotatedVideo:
    """An MP4 file of a video, whose frames are repeated until the next one's time. Raises
    UnwritableError naming it if it cannot be created."""

    def __init__(self, path: Path, first: Frame) -> None:
        if not opencv_takes(str(path)):
            raise UnwritableError(f"{path}: not UTF-8; name another folder by --out")
        self._path, self._count = path.absolute(), 0  # OpenCV takes `a:b.mp4` for an address
        self._source, self._shape, self._fps = first.source, first.rgb.shape, first.fps
        self._number, self._start_s = first.number, first.time_s or 0.0
        self._last: MatLike | None = None
        self._writer = _writer(str(self._path), first)
        if not self._writer.isOpened():
            raise UnwritableError(
                f"{path}: cannot be written as a video; name another folder by --out"
            )

    def is_continued_by(self, frame: Frame) -> bool:
        """Whether a frame belongs to the same video and has its size: OpenCV would drop others."""
        same = frame.source == self._source and frame.rgb.shape == self._shape
        return same and frame.number > self._number

    def add(self, rgb: Image, number: int, time_s: float) -> None:
        """Append a frame of this number."""
        gap = round((time_s - self._start_s) * self._fps) - self._count
        if gap > _LONGEST_GAP_S * self._fps:  # a camera that slept, or times that are wrong
            self._start_s += gap / self._fps
        elif self._last is not None:
            self._write(self._last, gap)
        self._last, self._number = cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), number
        self._write(self._last, 1)

    def _write(self, bgr: MatLike, times: int) -> None:
        for _ in range(times):
            self._writer.write(bgr)
            self._count += 1

    def close(self) -> None:
        """Finish the file. Raises UnwritableError if it lacks frames: OpenCV reports no failure."""
        self.release()
        if (stated_length(cv2.VideoCapture(str(self._path))) or 0) < self._count:
            raise incomplete(self._path)

    def release(self) -> None:
        """Finish the file as it is."""
        self._writer.release()


@contextmanager
def annotated_files(
    folder: Path, again: Set[str] = frozenset(), record: RunRecord | None = None
) -> Iterator[AnnotatedFiles]:
    """Pictures and videos in a folder, see `AnnotatedFiles`. The last video is finished even if
    prediction fails.

    Raises UnwritableError at the end if the last video is not complete.
    """
    files = AnnotatedFiles(folder, again, record)
    try:
        yield files
    finally:
        files.release()
    files.close()


def _writer(name: str, first: Frame) -> cv2.VideoWriter:
    rate, size = _writable_rate(first.fps), first.rgb.shape[1::-1]
    for code in (codec(), _MPEG4):  # H.264 takes no frames of odd sizes
        writer = cv2.VideoWriter(name, cv2.VideoWriter.fourcc(*code), rate, size)
        if writer.isOpened():
            break
    return writer


@cache
def codec() -> str:
    """The codec of drawings: H.264, which browsers play, if this OpenCV writes it, else MPEG-4."""
    # FFmpeg writes to standard error even if OpenCV's log is off.
    with TemporaryDirectory() as folder, output_hidden(2):
        path, code = f"{folder}/video.mp4", cv2.VideoWriter.fourcc(*_H264)
        found = cv2.VideoWriter(path, code, 25, (64, 64)).isOpened()
    return _H264 if found else _MPEG4


def _writable_rate(fps: float) -> float:
    """OpenCV writes rates as fractions, of which MPEG-4 takes no numerator above 65,535."""
    return round(fps, 3 if fps < 65 else 2 if fps < 650 else 0)


def unused(folder: Path, stem: str, suffix: str) -> tuple[Path, Path | None]:
    """The first of the paths stem.suffix, stem-2.suffix, ... in a folder that does not exist, and
    the one before it, if any. Raises InputError if its name is too long."""
    path, last, number = folder / f"{stem}.{suffix}", None, 1
    while os.path.lexists(path):
        number += 1
        path, last = folder / f"{stem}-{number}.{suffix}", path
    if len(os.fsencode(path.name)) > _LONGEST_NAME:
        raise InputError(f"no drawing: {path.name} is too long for a name; shorten the file's")
    return path, last


def _stem(source: str) -> str:
    """A file name for a video, a camera or a stream."""
    return "stream" if "://" in source else Path(source).stem.replace(" ", "-")
