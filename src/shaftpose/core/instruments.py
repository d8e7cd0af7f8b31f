"""Instruments in an image: annotated (`Annotations`) or detected (`Detections`).

Arrays follow the project's conventions: boxes are `x0, y0, x1, y1` in pixels of the image, poses
are `x_mm, y_mm, z_mm, pitch_deg, yaw_deg` in the camera frame of `shaftpose.core.geometry`.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.errors import InputError
from shaftpose.core.geometry import Camera

# In a map of instruments, next to 0 for background and 1, 2, ... for the shafts:
UNKNOWN = 255  # a pixel of which nothing is annotated
TOOL = 254  # another part of an instrument, such as jaws
TOOL_OR_SHAFT = 253  # an instrument of which nobody has outlined the shaft
OUTSIDE = 252  # outside the visible field of the image
POSE_DIMENSIONS = ("x_mm", "y_mm", "z_mm", "pitch_deg", "yaw_deg")


@dataclass(frozen=True)
class Annotations:
    """The annotated instruments of one image.

    boxes: (G, 4) float.
    poses: (G, 5) float; None if they are unknown.
    instances: (H, W), each pixel's shaft: 1, 2, ..., 0 for background, or one of the values above;
    None if not requested.
    tips_px: (G, 2), tips of instruments without poses, NaN where unknown.
    camera: in which the poses are given; None if there are none.
    """

    boxes: NDArray[np.float64]
    poses: NDArray[np.float64] | None
    instances: NDArray[np.uint8] | None = None
    tips_px: NDArray[np.float64] | None = None
    camera: Camera | None = None


@dataclass(frozen=True)
class Detections:
    """The detected instruments of one image, best score first.

    boxes: (K, 4) float; scores: (K,) in [0, 1]; poses: (K, 5) float.
    """

    boxes: NDArray[np.float64]
    scores: NDArray[np.float64]
    poses: NDArray[np.float64]

    def above(self, score: float) -> Self:
        """Only the detections whose score is at least `score`."""
        return self.rows(self.scores >= score)

    def rows(self, chosen: NDArray[np.intp] | NDArray[np.bool_]) -> Self:
        """The detections with these indices, or where the mask `chosen` (K,) is true."""
        return replace(self, **{name: values[chosen] for name, values in vars(self).items()})


def unpadded(
    boxes: NDArray[np.floating], scores: NDArray[np.floating], poses: NDArray[np.floating]
) -> list[Detections]:
    """The detections of each image from a network's decoded outputs, without padding.

    boxes: (B, K, 4); scores: (B, K), 0 for padding; poses: (B, K, 5). Raises InputError if one of
    them is NaN or infinite: it would be missed by comparisons, or spoil means.
    """
    arrays = [values.astype(np.float64) for values in (boxes, scores, poses)]
    if not all(np.isfinite(values).all() for values in arrays):
        raise InputError(
            "the model finds boxes, scores or poses that are not finite: export it again, or train "
            "it again"
        )
    return [Detections(b[s > 0], s[s > 0], p[s > 0]) for b, s, p in zip(*arrays, strict=True)]
