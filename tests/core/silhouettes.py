"""Soft masks of cylinders, by exact intersection of the rays of a finer camera."""

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.core.cylinder import cylinder_depth
from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.refinement.contour import Shaft

SIDE_PX, VIEW_DEG, FINER = 299, 95.0, 4
CAMERA = Camera.from_field_of_view(SIDE_PX, SIDE_PX, VIEW_DEG)
SHAFT = Shaft(diameter_mm=3.0, length_mm=150.0)
# In the middle, near the border with a steep shaft, from behind, and looking onto the end disc.
POSES = (
    np.array([0.0, 0.0, 20.0, 70.0, 40.0]),
    np.array([14.0, -9.0, 25.0, 55.0, 200.0]),
    np.array([-6.0, 4.0, 15.0, 100.0, 300.0]),
    np.array([6.0, 4.0, 15.0, 80.0, 30.0]),
)


def fine_mask(pose: NDArray[np.float64], finer: int = FINER) -> NDArray[np.bool_]:
    """The silhouette at `finer` times the resolution."""
    side_px = finer * SIDE_PX
    camera = Camera.from_field_of_view(side_px, side_px, VIEW_DEG)
    pose_there = ShaftPose.from_array(pose)
    return np.isfinite(cylinder_depth(camera, pose_there, SHAFT.diameter_mm, SHAFT.length_mm))


def soft_mask(pose: NDArray[np.float64], times: int = 1) -> NDArray[np.float32]:
    """The covered share of each pixel, with `times` 299 pixels a side."""
    fine, side_px = fine_mask(pose).astype(np.float32), times * SIDE_PX
    shares = cv2.resize(fine, (side_px, side_px), interpolation=cv2.INTER_AREA)
    return np.asarray(shares, dtype=np.float32)
