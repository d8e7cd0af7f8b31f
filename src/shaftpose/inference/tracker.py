"""Follows shafts from frame to frame: numbers them and smooths their poses."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from shaftpose.core.geometry import ShaftPose
from shaftpose.core.images import Image
from shaftpose.inference.found_shafts import Array, FoundShaft
from shaftpose.inference.frames import Frame
from shaftpose.inference.tracks import Measurement, Track

# A shaft is the same one if its tip and axis are this near to where its track expects them.
_NEAR_MM, _NEAR_DEG = 12.0, 45.0
_LONGEST_GAP_S = 0.5  # without a detection; after it, a shaft is a new one
# Standard deviations of poses that were not fitted: mean errors of the bundled network alone.
_UNFITTED = np.array([0.7, 0.7, 1.5, 6.0, 5.0])

# The images (2, 2) of a pose's tip and axis in a frame.
AxisPx = Callable[[ShaftPose, Image], Array]


class Tracker:
    """Numbers the shafts of each video or stream from 1 and smooths their poses with what earlier
    frames showed.

    Deviations stay those of the single frame: errors of successive frames are alike, so that
    smoothing removes less of them than the filter believes. axis_px: for drawing smoothed poses.
    """

    def __init__(self, axis_px: AxisPx) -> None:
        self._axis_px = axis_px
        self._source, self._tracks, self._count = "", list[Track](), 0

    def __call__(self, frame: Frame, shafts: Sequence[FoundShaft]) -> list[FoundShaft]:
        """The shafts with numbers and smoothed poses; unchanged in an image file."""
        if frame.fps is None:
            return list(shafts)
        if frame.source != self._source or frame.number == 0:
            self._source, self._tracks, self._count = frame.source, [], 0
        time_s = frame.number / frame.fps
        self._tracks = [t for t in self._tracks if time_s - t.time_s <= _LONGEST_GAP_S]
        seen = [_measured(shaft) for shaft in shafts]
        known = matches([one.predicted(time_s) for one in self._tracks], [m.values for m in seen])
        tracks = [self._followed(known.get(row), one, time_s) for row, one in enumerate(seen)]
        return [
            self._smoothed(shaft, track, frame.rgb)
            for shaft, track in zip(shafts, tracks, strict=True)
        ]

    def _followed(self, known: int | None, seen: Measurement, time_s: float) -> Track:
        if known is not None:
            self._tracks[known].update(seen, time_s)
            return self._tracks[known]
        self._count += 1
        self._tracks.append(Track(self._count, seen, time_s))
        return self._tracks[-1]

    def _smoothed(self, shaft: FoundShaft, track: Track, rgb: Image) -> FoundShaft:
        pose = track.pose()
        return replace(
            shaft,
            pose=pose,
            axis_px=self._axis_px(pose, rgb),
            track=track.number,
        )


def matches(expected: Sequence[Array], seen: Sequence[Array]) -> dict[int, int]:
    """For each of the seen shafts (6,: tip and axis) that is near enough to an expected one, the
    number of that one; nearest tips first."""
    pairs = [
        (float(np.linalg.norm(one[:3] - other[:3])), row, column)
        for row, one in enumerate(seen)
        for column, other in enumerate(expected)
        if one[3:] @ other[3:] >= np.cos(np.radians(_NEAR_DEG))
    ]
    found: dict[int, int] = {}
    for distance, row, column in sorted(pairs):
        if distance <= _NEAR_MM and row not in found and column not in found.values():
            found[row] = column
    return found


def _measured(shaft: FoundShaft) -> Measurement:
    return Measurement(shaft.pose, _UNFITTED if shaft.deviations is None else shaft.deviations)
