"""The outline of a shaft in the image, from its contour within and around the image.

A shaft that the image's border cuts along its length has only one of its lines in the image. Of
one that is wider than the image, corners may be missing.
"""

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.core.geometry import Camera, Disc
from shaftpose.refinement.contour import Array, Shaft, shaft_contour

# A convex outline in the image, (N, 2) px.
Outline = NDArray[np.float32]

_CORNERS = 72  # of the polygon for a round field, off by 0.1 % of its radius


def contour_around(pose: Array, shaft: Shaft, camera: Camera) -> Array:
    """Points (N, 2) px of a shaft's contour in the image and up to a side's length around it."""
    margin = max(camera.width, camera.height)
    size = camera.width + 2 * margin, camera.height + 2 * margin
    around = replace(camera, field=None).cropped(-margin, -margin, *size)
    return np.asarray(shaft_contour(pose, shaft, around).points - margin)


def visible_outline(pose: Array, shaft: Shaft, camera: Camera) -> Outline:
    """The outline of what a shaft covers of the image and its round field; no points if nothing."""
    outline = contour_around(pose, shaft, camera).astype(np.float32)
    if len(outline) < 3:
        return outline[:0]
    image = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * [camera.width, camera.height]
    borders = [image] if camera.field is None else [image, _corners(camera.field)]
    outline = np.asarray(cv2.convexHull(outline)[:, 0], np.float32)
    for border in borders:
        area, both = cv2.intersectConvexConvex(outline, border.astype(np.float32))
        if area <= 0:
            return outline[:0]
        outline = np.asarray(both[:, 0], np.float32)
    return outline


def _corners(field: Disc) -> Array:
    turns = np.linspace(0, 2 * np.pi, _CORNERS, endpoint=False)[:, None]
    return [field.x, field.y] + field.diameter / 2 * np.hstack([np.cos(turns), np.sin(turns)])
