"""Follows shafts from frame to frame: numbers them and smooths their poses."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from shaftpose.core.geometry import Array, ShaftPose
from shaftpose.core.images import Image
from shaftpose.frame_sources.frames import Frame, FrameId
from shaftpose.inference.found_shafts import FoundShaft
from shaftpose.inference.tracks import Measurement, Track
from shaftpose.metrics.detection.matching import nearest_pairs

# A shaft continues a track if its tip and axis are this near to the predicted ones.
_NEAR_DIAMETERS, _NEAR_DEG = 4.0, 45.0
_LONGEST_GAP_S = 0.5  # without a detection, before a track ends
# Standard deviations, in diameters and deg, of poses that were not fitted: about the errors of the
# bundled network.
_UNFITTED = np.array([0.3, 0.3, 0.6, 8.0, 6.0])
_USUAL_MM = 3.0  # assumed if the diameter is unknown

# Projects a pose's tip and axis into a frame of this pixel aspect, (2, 2) px.
AxisPx = Callable[[ShaftPose, Image, float], Array]


class ShaftTracker:
    """Numbers the shafts of each film from 1 and smooths their poses over time. A film is a video,
    a stream, or the images of a folder, which are taken for frames of the usual rate.

    Deviations stay those of the single frame: errors of successive frames are correlated, so
    smoothing reduces them less than the filter assumes. axis_px: projects smoothed poses.
    diameter_mm: of the shafts, None if unknown.
    """

    def __init__(self, axis_px: AxisPx, diameter_mm: float | None) -> None:
        self._axis_px, self._diameter_mm = axis_px, diameter_mm or _USUAL_MM
        self._film, self._tracks, self._count = "", list[Track](), 0
        self._last_s = 0.0  # time of the last frame

    def __call__(self, frame: Frame, shafts: Sequence[FoundShaft]) -> list[FoundShaft]:
        """The shafts with numbers and smoothed poses."""
        film, time_s = film_of(frame), frame.time_s
        if time_s is None:
            time_s = self._last_s + 1 / frame.fps
        if film != self._film or time_s < self._last_s:
            self._film, self._tracks, self._count = film, [], 0
        # At low frame rates, too, a shaft of the last frame may be the same.
        since = min(time_s - _LONGEST_GAP_S, self._last_s)
        self._tracks, self._last_s = [t for t in self._tracks if t.time_s >= since], time_s
        seen = [self._measured(shaft) for shaft in shafts]
        known = matches(
            [one.predicted(time_s) for one in self._tracks], [m.values for m in seen],
            _NEAR_DIAMETERS * self._diameter_mm,
        )  # fmt: skip
        tracks = [self._followed(known.get(row), one, time_s) for row, one in enumerate(seen)]
        return [
            self._smoothed(shaft, track, frame) for shaft, track in zip(shafts, tracks, strict=True)
        ]

    def _followed(self, known: int | None, seen: Measurement, time_s: float) -> Track:
        if known is not None:
            self._tracks[known].update(seen, time_s)
            return self._tracks[known]
        self._count += 1
        self._tracks.append(Track(self._count, seen, time_s))
        return self._tracks[-1]

    def _smoothed(self, shaft: FoundShaft, track: Track, frame: Frame) -> FoundShaft:
        pose = track.pose()
        return replace(
            shaft,
            pose=pose,
            axis_px=self._axis_px(pose, frame.rgb, frame.aspect),
            track=track.number,
        )

    def _measured(self, shaft: FoundShaft) -> Measurement:
        unfitted = _UNFITTED * ([self._diameter_mm] * 3 + [1.0] * 2)
        if shaft.deviations is None:
            return Measurement(shaft.pose, unfitted)
        if shaft.tip == "seen":
            return Measurement(shaft.pose, shaft.deviations)
        # The fit knows where the shaft is; only along the axis may its tip lie elsewhere.
        along_mm = float(np.linalg.norm(shaft.deviations[:3]))
        return Measurement(shaft.pose, np.minimum(shaft.deviations, unfitted), along_mm)


def film_of(frame: FrameId) -> str:
    """The film that a frame belongs to: its source, or the folder of an image."""
    return frame.source if frame.time_s is not None else str(Path(frame.source).parent)


def matches(expected: Sequence[Array], seen: Sequence[Array], near_mm: float) -> dict[int, int]:
    """Match seen to expected shafts, (6,) each, see `tip_and_axis`: index of a seen shaft -> index
    of the expected one.

    Tips are at most `near_mm` apart, and axes are similar; the nearest tips are matched first.
    """
    ones, others = (np.reshape(shafts, (-1, 6)) for shafts in (seen, expected))
    distances = np.linalg.norm(ones[:, None, :3] - others[None, :, :3], axis=2)
    distances[ones[:, 3:] @ others[:, 3:].T < np.cos(np.radians(_NEAR_DEG))] = np.inf
    return nearest_pairs(distances, near_mm)
