"""Frames with what was found in them; lines and text grow with the frame."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.core.drawing import FOUND, pose_text
from shaftpose.core.images import Image
from shaftpose.inference.found_shafts import FoundShaft

_PLAIN_PX = 299  # side of a frame with lines of one pixel
_FARTHEST_PX = 1e4  # OpenCV's range is limited
_SUBPIXEL_BITS = 4


def draw_shafts(rgb: Image, shafts: Sequence[FoundShaft]) -> Image:
    """The frame (H, W, 3) with boxes, tips, axes and poses (mm, deg); poses that are not metric
    are marked."""
    drawn, scale = rgb.copy(), max(min(rgb.shape[:2]) / _PLAIN_PX, 0.5)
    thickness, bits = max(round(scale), 1), _SUBPIXEL_BITS
    for row, shaft in enumerate(shafts):
        low, high = _grid(shaft.box.reshape(2, 2))
        cv2.rectangle(drawn, low, high, FOUND, thickness, cv2.LINE_AA, bits)
        tip, end = _grid(shaft.axis_px)
        cv2.line(drawn, tip, end, FOUND, thickness, cv2.LINE_AA, bits)
        cv2.circle(drawn, tip, round(3 * scale) << bits, FOUND, thickness, cv2.LINE_AA, bits)
        text = pose_text(shaft.pose.as_array()) + ("" if shaft.metric else "  not metric")
        _write(drawn, text, rgb.shape[0] - round((8 + 19 * row) * scale), scale)
    return drawn


def _grid(points: NDArray[np.float64]) -> list[list[int]]:
    """Pixels (N, 2) in OpenCV's fixed-point grid, whose origin is the first pixel's centre."""
    near = np.clip(points - 0.5, -_FARTHEST_PX, _FARTHEST_PX)
    grid: list[list[int]] = np.rint(near * (1 << _SUBPIXEL_BITS)).astype(int).tolist()
    return grid


def _write(image: Image, text: str, bottom_px: int, scale: float) -> None:
    """Write text with a dark outline, readable on any background."""
    light = tuple((channel + 255) // 2 for channel in FOUND)
    for shade, width in (((0, 0, 0), 3), (light, 1)):
        cv2.putText(
            image, text, (round(4 * scale), bottom_px), cv2.FONT_HERSHEY_SIMPLEX, 0.4 * scale,
            shade, max(round(width * scale), 1), cv2.LINE_AA,
        )  # fmt: skip
