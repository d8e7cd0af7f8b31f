"""Initial poses, for a fit, of shafts that the mask shows and no detection explains.

Where a tip is hidden or continues in jaws, a network's heat map often misses it, while the mask
still shows the shaft.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.core.geometry import Camera, unsigned_deg
from shaftpose.refinement.contour import Array, Shaft, shaft_contour

_MARGIN_PX = 7  # around an explained shaft: pixels that belong to it, too
_OPENING = np.ones((5, 5), np.uint8)  # thinner regions are no shafts
_LEAST_PX = 300  # of a region
_LEAST_LENGTH = 1.2  # of a region, in widths
_END_SHARE, _END_PX = 0.12, 6.0  # of a region's length: the end that gives tip and width
_DEPTHS_MM = (5.0, 60.0)
_PITCHES_DEG = (60.0, 85.0)  # from one of them, the fit converges


def initial_poses_from_mask(
    mask: NDArray[np.float32], poses: Sequence[Array], shaft: Shaft, camera: Camera
) -> Array:
    """Initial poses (M, 5), two for each region of a mask (H, W) in [0, 1] that no shaft with one
    of `poses` covers.

    The tip is the end of the region that is farther from the image's border. The region's width
    gives the depth.
    """
    shown = (mask > 0.5).astype(np.uint8)
    for pose in poses:
        _erase(shown, pose, shaft, camera)
    count, regions, statistics, _ = cv2.connectedComponentsWithStats(
        cv2.morphologyEx(shown, cv2.MORPH_OPEN, _OPENING)
    )
    large = [n for n in range(1, count) if statistics[n, cv2.CC_STAT_AREA] >= _LEAST_PX]
    found = [pose for n in large for pose in _poses_of(regions == n, shaft, camera)]
    return np.array(found).reshape(-1, 5)


def _erase(shown: NDArray[np.uint8], pose: Array, shaft: Shaft, camera: Camera) -> None:
    """Set the pixels of a shaft and of a margin around it to 0."""
    points = shaft_contour(pose, shaft, camera).points
    if len(points):
        hull = cv2.convexHull(points.astype(np.float32)).round().astype(np.int32)
        cv2.fillConvexPoly(shown, hull, (0,))
        cv2.polylines(shown, [hull], True, (0,), 2 * _MARGIN_PX)


def _poses_of(region: NDArray[np.bool_], shaft: Shaft, camera: Camera) -> list[Array]:
    """The poses of one region; none if it is not long enough."""
    points = np.argwhere(region)[:, ::-1] + 0.5
    middle = points.mean(axis=0)
    direction = np.linalg.svd(points - middle, full_matrices=False)[2][0]
    ends = [_end(points, middle, sign * direction) for sign in (1, -1)]
    (tail, tail_width), (tip, width) = sorted(ends, key=lambda end: float(camera.border_px(end[0])))
    if np.linalg.norm(tail - tip) < _LEAST_LENGTH * max(tail_width, width):
        return []
    z_mm = float(np.clip(camera.focal_px * shaft.diameter_mm / width, *_DEPTHS_MM))
    x_mm, y_mm = camera.lift(tip, z_mm)
    yaw_deg = unsigned_deg(float(np.degrees(np.arctan2(*(tail - tip)[::-1]))))
    return [np.array([x_mm, y_mm, z_mm, pitch, yaw_deg]) for pitch in _PITCHES_DEG]


def _end(points: Array, middle: Array, direction: Array) -> tuple[Array, float]:
    """The end (2,) px of a region of points (N, 2) in a direction, and the width there, px."""
    across = np.array([-direction[1], direction[0]])
    along, aside = (points - middle) @ direction, (points - middle) @ across
    last = aside[along > along.max() - max(_END_PX, _END_SHARE * np.ptp(along))]
    low, high = np.quantile(last, [0.03, 0.97])  # without stray pixels
    return middle + along.max() * direction + np.median(last) * across, float(high - low + 1)
