"""A recording of frames and found shafts for Rerun's viewer, in the camera's frame in mm."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import rerun

from shaftpose.core.geometry import Array
from shaftpose.core.images import Image
from shaftpose.frame_sources.frames import Frame
from shaftpose.inference.annotated_files import shaft_text
from shaftpose.inference.found_shafts import FoundShaft, axis_points
from shaftpose.inference.prediction_run import Write
from shaftpose.inference.result_stream import incomplete, naming_unwritable

_NAME, _TIMELINE = "predictions.rrd", "frame"
_CAMERA, _IMAGE = "camera", "camera/image"
_BOXES, _SHAFTS, _SOURCE = "camera/image/boxes", "shafts", "source"
_JPEG_QUALITY = 90
_END = bytes(16)  # of a complete file; Rerun only logs failures to write

# The intrinsic matrix (3, 3) of a frame (H, W, 3) of this pixel aspect.
CameraMatrix = Callable[[Image, float], Array]


class RerunFile:
    """A recording: for each frame its image, boxes with poses as text, and 10 mm of the axes.

    Its timeline counts the frames of all sources. camera_matrix: of a frame; diameter_mm: of the
    shafts, None if unknown.
    """

    def __init__(
        self,
        recording: rerun.RecordingStream,
        camera_matrix: CameraMatrix,
        diameter_mm: float | None,
    ) -> None:
        self._recording, self._camera_matrix = recording, camera_matrix
        self._radius_mm, self._count = None if diameter_mm is None else diameter_mm / 2, 0

    def add(self, frame: Frame, shafts: Sequence[FoundShaft]) -> None:
        """Append a frame."""
        texts = [shaft_text(shaft) for shaft in shafts]
        boxes = np.array([shaft.box for shaft in shafts]).reshape(-1, 4)
        axes = [axis_points(shaft.pose) for shaft in shafts]
        height, width = frame.rgb.shape[:2]
        self._recording.set_time(_TIMELINE, sequence=self._count)
        self._count += 1
        self._log(_SOURCE, rerun.TextLog(f"{frame.source}, frame {frame.number}"))
        matrix = self._camera_matrix(frame.rgb, frame.aspect)
        self._log(_CAMERA, rerun.Pinhole(
            image_from_camera=matrix, resolution=[width, height],
            camera_xyz=rerun.ViewCoordinates.RDF,
        ))  # fmt: skip
        self._log(_IMAGE, rerun.Image(frame.rgb).compress(_JPEG_QUALITY))
        self._log(
            _BOXES,
            rerun.Boxes2D(array=boxes, array_format=rerun.Box2DFormat.XYXY, labels=texts),
        )
        self._log(_SHAFTS, rerun.LineStrips3D(axes, radii=self._radius_mm))

    def _log(self, entity: str, what: Any) -> None:
        self._recording.log(entity, what, strict=True)  # errors would be warnings otherwise


@contextmanager
def rerun_file(
    folder: Path, camera_matrix: CameraMatrix, diameter_mm: float | None
) -> Iterator[Write]:
    """Open a new recording in a folder; the result appends a frame with its shafts, see
    `RerunFile`.

    Raises UnwritableError naming the file if it exists already, cannot be created or, at the end,
    is not complete.
    """
    path = folder / _NAME
    with naming_unwritable(path):
        path.open("x").close()
    recording = rerun.RecordingStream("shaftpose")
    recording.save(path)
    try:
        yield RerunFile(recording, camera_matrix, diameter_mm).add
    finally:
        recording.flush()
        recording.disconnect()
    if not _is_complete(path):
        raise incomplete(path)


def _is_complete(path: Path) -> bool:
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - len(_END)))
        return file.read() == _END
