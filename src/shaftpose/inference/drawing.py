"""Frames with what was found in them; lines and text grow with the frame."""

from collections.abc import Sequence

import cv2

from shaftpose.core.images import Image
from shaftpose.figures.drawing import (
    FOUND,
    LINE_PX,
    SUBPIXEL_BITS,
    pose_text,
    subpixel_grid,
    write_text,
)
from shaftpose.inference.found_shafts import FoundShaft

_PLAIN_PX = 299  # side of a frame with lines of one pixel


def draw_shafts(rgb: Image, shafts: Sequence[FoundShaft]) -> Image:
    """The frame (H, W, 3) with boxes, tips, axes and poses (mm, deg); poses that are not metric
    are marked."""
    drawn, scale = rgb.copy(), max(min(rgb.shape[:2]) / _PLAIN_PX, 0.5)
    thickness, bits = max(round(scale), 1), SUBPIXEL_BITS
    for row, shaft in enumerate(sorted(shafts, key=lambda shaft: shaft.track or 0)):
        low, high = subpixel_grid(shaft.box.reshape(2, 2)).tolist()
        cv2.rectangle(drawn, low, high, FOUND, thickness, cv2.LINE_AA, bits)
        tip, end = subpixel_grid(shaft.axis_px).tolist()
        cv2.line(drawn, tip, end, FOUND, thickness, cv2.LINE_AA, bits)
        cv2.circle(drawn, tip, round(3 * scale) << bits, FOUND, thickness, cv2.LINE_AA, bits)
        below = round((8 + LINE_PX * row) * scale)
        write_text(drawn, shaft_text(shaft), (round(4 * scale), rgb.shape[0] - below), FOUND, scale)
    return drawn


def shaft_text(shaft: FoundShaft) -> str:
    """A shaft's number, if it has one, and pose (mm, deg); marked if that is not metric."""
    number = "" if shaft.track is None else f"{shaft.track}: "
    return number + pose_text(shaft.pose.as_array()) + ("" if shaft.metric else "  not metric")
