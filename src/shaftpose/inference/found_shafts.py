"""A shaft found in a frame, in pixels of that frame."""

from dataclasses import dataclass

import numpy as np

from shaftpose.core.geometry import Array, ShaftPose
from shaftpose.inference.views import View
from shaftpose.refinement.refiner import TipState

AXIS_MM = 10.0  # drawn length of an axis
# A tip behind the camera has no image: it is projected from at least this depth, a share of its
# distance from the optical axis, and at least so many mm.
_LEAST_DEPTH, _LEAST_DEPTH_MM = 0.01, 1e-6
# Points on the sides of the unit square: a lens bends the sides of a box.
_ALONG = [(along, end) for along in np.linspace(0, 1, 9) for end in (0, 1)]
_AROUND = np.array(_ALONG + [(end, along) for along, end in _ALONG])


@dataclass(frozen=True)
class FoundShaft:
    """A shaft in a frame.

    score: in [0, 1]. box: (4,) x0, y0, x1, y1, clipped to the frame. axis_px: (2, 2), the tip and
    the point of the axis 10 mm towards the handle, or less where the depth would fall below half;
    both may lie outside the frame. metric: whether the pose's millimetres hold for the user's
    camera and shaft. tip: whether the frame shows it. deviations: (5,) standard deviations of a
    fitted pose, mm and deg. track: the shaft's number in the video, if shafts are tracked.
    """

    score: float
    box: Array
    axis_px: Array
    pose: ShaftPose
    metric: bool
    tip: TipState
    deviations: Array | None = None
    track: int | None = None

    @property
    def tip_px(self) -> Array:
        """(2,) the image of the tip."""
        return self.axis_px[0]


def axis_points(pose: ShaftPose) -> Array:
    """The tip and the second point of `FoundShaft.axis_px`, (2, 3) in mm."""
    tip, axis = pose.tip_mm.astype(float), pose.direction
    tip[2] = max(tip[2], _LEAST_DEPTH * np.hypot(tip[0], tip[1]), _LEAST_DEPTH_MM)
    approach = -axis[2]  # to the camera's plane, per mm
    length = min(AXIS_MM, tip[2] / (2 * approach)) if approach > 0 else AXIS_MM
    return np.stack([tip, tip + length * axis])


def axis_px(pose: ShaftPose, view: View) -> Array:
    """Project `axis_points` into a frame, (2, 2) px."""
    return view.image_px(view.camera.project(axis_points(pose)))


def box_px(box: Array, view: View, width: int, height: int) -> Array:
    """The bounding box (4,) in a frame of a box (4,) in the model's image, clipped to the frame."""
    outline = np.clip(view.image_px(box[:2] + _AROUND * (box[2:] - box[:2])), 0, [width, height])
    return np.concatenate([outline.min(axis=0), outline.max(axis=0)])
