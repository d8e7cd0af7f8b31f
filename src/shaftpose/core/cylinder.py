"""The exact silhouette of a cylinder, and distances between axes."""

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.geometry import Array, Camera, ShaftPose


def cylinder_depth(
    camera: Camera, pose: ShaftPose, diameter_mm: float, length_mm: float, stride: int = 1
) -> Array:
    """Depth z (h, w) in mm where the ray through a pixel's centre hits the cylinder, else infinity.

    Intersects each ray exactly with the side and the two end discs. Outside the field of view the
    depth is infinite, too.
    """
    rays = camera.rays(stride)
    tip, axis, radius = pose.tip_mm, pose.direction, diameter_mm / 2
    depth = np.full(rays.shape[:2], np.inf)
    near = _near_line(rays, tip, axis, 1.001 * radius)  # all other rays miss the cylinder
    rays = rays[near]
    nearest = np.full(len(rays), np.inf)
    for hit in (*_side_hits(rays, tip, axis, radius, length_mm),
                _disc_hits(rays, tip, axis, radius),
                _disc_hits(rays, tip + length_mm * axis, axis, radius)):  # fmt: skip
        nearest = np.where(hit > 0, np.minimum(nearest, hit), nearest)
    depth[near] = nearest
    return depth


def _near_line(rays: Array, point: Array, axis: Array, reach: float) -> NDArray[np.bool_]:
    """Whether rays (..., 3) from the origin come within `reach` of the line through `point`.

    Two lines are |r . (p x a)| / |r x a| apart. A parallel ray counts as near, because |r x a| is 0
    up to rounding.
    """
    across = np.einsum("...i,...i", rays, rays) - (rays @ axis) ** 2
    near: NDArray[np.bool_] = (rays @ np.cross(point, axis)) ** 2 <= reach**2 * across + 1e-6
    return near


def _side_hits(
    rays: Array, tip: Array, axis: Array, radius: float, length_mm: float
) -> tuple[Array, Array]:
    """Ray parameters (N,) at the two crossings of the side by rays (N, 3); NaN where none."""
    along_ray, along_tip = rays @ axis, float(tip @ axis)
    across_ray = rays - along_ray[..., None] * axis
    across_tip = tip - along_tip * axis
    a = np.sum(across_ray**2, axis=-1)
    b = across_ray @ across_tip
    c = float(across_tip @ across_tip) - radius**2
    with np.errstate(invalid="ignore", divide="ignore"):
        root = np.sqrt(b**2 - a * c)
        near, far = (b - root) / a, (b + root) / a
        return (
            _within(near, along_ray * near - along_tip, length_mm),
            _within(far, along_ray * far - along_tip, length_mm),
        )


def _within(hits: Array, height: Array, length_mm: float) -> Array:
    return np.where((height >= 0) & (height <= length_mm), hits, np.nan)


def _disc_hits(rays: Array, centre: Array, normal: Array, radius: float) -> Array:
    """Ray parameters (N,) at the crossing of a disc by rays (N, 3); NaN where none."""
    with np.errstate(invalid="ignore", divide="ignore"):
        hits = float(centre @ normal) / (rays @ normal)
        distance = np.linalg.norm(hits[..., None] * rays - centre, axis=-1)
    return np.where(distance <= radius, hits, np.nan)


def segment_distance(start_a: Array, end_a: Array, start_b: Array, end_b: Array) -> float:
    """Shortest distance between two segments in space (C. Ericson, Real-Time Collision
    Detection, 5.1.9). Points are (3,); the first segment may be a single point."""
    along_a, along_b, between = end_a - start_a, end_b - start_b, start_a - start_b
    a, e, f = along_a @ along_a, along_b @ along_b, along_b @ between
    b, c = along_a @ along_b, along_a @ between
    denominator = float(a * e - b * b)
    s = float(np.clip((b * f - c * e) / denominator, 0, 1)) if denominator > 1e-12 else 0.0
    t = (b * s + f) / e if e > 1e-12 else 0.0
    if not 0 <= t <= 1:
        t = float(np.clip(t, 0, 1))
        s = float(np.clip((b * t - c) / a, 0, 1)) if a > 1e-12 else 0.0
    return float(np.linalg.norm(start_a + s * along_a - start_b - t * along_b))
