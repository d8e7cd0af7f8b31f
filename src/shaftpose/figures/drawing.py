"""Visualisation: images with boxes, axes, masks and pose text, and contact sheets."""

from collections.abc import Sequence
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.core.images import Image
from shaftpose.core.instruments import Annotations, Detections
from shaftpose.core.shards import ShardedDataset

T = TypeVar("T")
Colour = tuple[int, int, int]

# Okabe and Ito's palette, safe for colour-blind readers.
TRUTH: Colour = (0, 158, 115)
FOUND: Colour = (240, 228, 66)
LINE_PX = 19  # an outlined line of text is 18 px high, 7 px of it below the baseline
_SHORTEST_VIEW_MM = 3.0  # the drawn axis ends before the camera's plane
_AXIS_MM, _AXIS_STEPS = 150.0, 150  # enough for a smooth curve under lens distortion
SUBPIXEL_BITS = 4


def draw_sample(shards: ShardedDataset, key: str) -> Image:
    """A rendered image with its masks (yellow), boxes and poses (green)."""
    outlined = draw_masks(shards.rgb(key), shards.masks(key), FOUND)
    return draw_annotations(outlined, shards.annotations(key), shards.camera(key))


def draw_real(
    image: Image, masks: Sequence[NDArray[np.bool_]], boxes: NDArray[np.float64]
) -> Image:
    """A real image (H, W, 3) with its masks (yellow) and boxes (N, 4) px (green)."""
    return draw_boxes(draw_masks(image, masks, FOUND), boxes, TRUTH)


def draw_annotations(image: Image, known: Annotations, camera: Camera, text: bool = True) -> Image:
    """The image (H, W, 3) RGB with its annotated boxes and, if known, poses."""
    drawn = draw_boxes(image, known.boxes, TRUTH)
    return drawn if known.poses is None else draw_poses(drawn, known.poses, camera, TRUTH, text)


def draw_detections(image: Image, found: Detections, camera: Camera) -> Image:
    """The image with its detected boxes and poses."""
    return draw_poses(draw_boxes(image, found.boxes, FOUND), found.poses, camera, FOUND)


def prediction_sheet(
    images: Sequence[Image],
    known: Sequence[Annotations],
    found: Sequence[Detections],
    cameras: Sequence[Camera],
    columns: int,
) -> Image:
    """Contact sheet of equally sized images with annotations (green) and detections (yellow)."""
    drawn = [
        draw_detections(draw_annotations(image, there, camera, text=False), detections, camera)
        for image, there, detections, camera in zip(images, known, found, cameras, strict=True)
    ]
    return contact_sheet(drawn, columns)


def draw_boxes(image: Image, boxes: NDArray[np.float64], colour: Colour) -> Image:
    """The image (H, W, 3) RGB with boxes (N, 4) px."""
    drawn = image.copy()
    for x0, y0, x1, y1 in np.rint(boxes).astype(int).tolist():
        cv2.rectangle(drawn, (x0, y0), (x1 - 1, y1 - 1), colour, 1)
    return drawn


def draw_masks(image: Image, masks: Sequence[NDArray[np.bool_]], colour: Colour) -> Image:
    """The image with the outlines of masks (H, W)."""
    drawn = image.copy()
    for mask in masks:
        outline, _ = cv2.findContours(
            mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
        )
        cv2.drawContours(drawn, outline, -1, colour, 1, cv2.LINE_AA)
    return drawn


def draw_poses(
    image: Image, poses: NDArray[np.float64], camera: Camera, colour: Colour, text: bool = True
) -> Image:
    """The image with tip and projected axis of poses (N, 5) and, if `text`, their numbers."""
    drawn = image.copy()
    for row, pose in enumerate(poses):
        axis = subpixel_grid(camera.project(_axis_mm(ShaftPose.from_array(pose))))
        cv2.polylines(drawn, [axis], False, colour, 1, cv2.LINE_AA, SUBPIXEL_BITS)
        radius = 3 << SUBPIXEL_BITS
        cv2.circle(drawn, axis[0].tolist(), radius, colour, 1, cv2.LINE_AA, SUBPIXEL_BITS)
        if text:
            write_text(drawn, pose_text(pose), (4, image.shape[0] - 8 - LINE_PX * row), colour)
    return drawn


def draw_caption(image: Image, text: str) -> Image:
    """The image with a line of white text in its upper left corner."""
    drawn = image.copy()
    write_text(drawn, text, (4, 15), (255, 255, 255))
    return drawn


def pose_text(pose: NDArray[np.float64]) -> str:
    """A pose (5,) as a line of text: x, y, z in mm, pitch p and yaw w in deg."""
    x, y, z, pitch, yaw = (f"{value:.1f}" for value in pose)
    return f"x {x} y {y} z {z}  p {pitch} w {yaw}"


def evenly_spaced(items: Sequence[T], count: int) -> list[T]:
    """At most `count` items at even spacing."""
    count = min(count, len(items))
    return [items[n * len(items) // count] for n in range(count)]


def contact_sheet(images: Sequence[Image], columns: int) -> Image:
    """Equally sized images in rows; the last row is padded with black."""
    rows = -(-len(images) // columns)
    blank = np.zeros_like(images[0])
    padded = [*images, *[blank] * (rows * columns - len(images))]
    lines = [np.hstack(padded[n * columns : (n + 1) * columns]) for n in range(rows)]
    return np.vstack(lines)


def _axis_mm(pose: ShaftPose) -> NDArray[np.float64]:
    """Points (N, 3) on the axis, from the tip to 150 mm or just before the camera's plane."""
    tip = pose.tip_mm.copy()
    tip[2] = max(tip[2], _SHORTEST_VIEW_MM)
    slope = -pose.direction[2]
    length = _AXIS_MM if slope <= 0 else min(_AXIS_MM, (tip[2] - _SHORTEST_VIEW_MM) / slope)
    return tip + np.linspace(0, length, _AXIS_STEPS + 1)[:, None] * pose.direction


def subpixel_grid(points: NDArray[np.float64]) -> NDArray[np.int32]:
    """Pixels (N, 2) in OpenCV's fixed-point grid, whose origin is the first pixel's centre."""
    near = np.clip(points - 0.5, -1e4, 1e4)  # OpenCV's range is limited
    return np.rint(near * (1 << SUBPIXEL_BITS)).astype(np.int32)


def write_text(
    image: Image, text: str, origin: tuple[int, int], colour: Colour, scale: float = 1.0
) -> None:
    """Write text with a dark outline, readable on any background, in place. Its thin strokes are
    lighter than lines of the same colour. scale: 1 for lines of `LINE_PX`."""
    light = tuple((channel + 255) // 2 for channel in colour)
    for shade, width in (((0, 0, 0), 3), (light, 1)):
        cv2.putText(
            image, text, origin, cv2.FONT_HERSHEY_SIMPLEX, 0.4 * scale, shade,
            max(round(width * scale), 1), cv2.LINE_AA,
        )  # fmt: skip
