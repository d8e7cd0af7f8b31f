"""The shape of procedural tissue: a wall, a funnel into it, and folds and bulges in front of it.

Lengths are in image sides. Depth is exp(-VIEW * height): it is one at height zero, and a slope
looks equally steep at every depth.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.backgrounds.noise import (
    Field,
    Range,
    blurred,
    fractal_noise,
    pixel_grid,
    smooth_noise,
)

# Pieces of different tissue in one image, including the wall.
SURFACES = 3
# Width of the view at depth one: twice the tangent of half the field of view, here 74 degrees.
VIEW = 1.5


@dataclass(frozen=True)
class Relief:
    """Height field and tissue labels.

    height: (S, S) float32; surface: (S, S) uint8 < SURFACES, tissue of each pixel (0: the wall).
    """

    height: Field
    surface: NDArray[np.uint8]


def make_relief(
    rng: np.random.Generator, size_px: int, folds: int, fold_radius: Range, opened: bool
) -> Relief:
    """A wall, with a funnel if `opened`, behind a number of occluding `folds`."""
    height = wall(rng, size_px)
    if opened:
        height += funnel(rng, size_px)
    # The wall may lie far behind the folds, in little light.
    height -= np.float32(max(rng.uniform(-0.6, 0.6), 0))
    surface = np.zeros((size_px, size_px), dtype=np.uint8)
    for _ in range(folds):
        bulge = fold(rng, size_px, fold_radius)
        if rng.random() < 0.4:
            height = melted(height, bulge, rng.uniform(0.02, 0.12))
        else:
            surface[bulge > height] = rng.integers(1, SURFACES)
            height = melted(height, bulge, 0.004)
    # A slight blur rounds the cut edges, as in soft tissue.
    return Relief(blurred(height, 0.004), surface)


def melted(height: Field, bulge: Field, width: float) -> Field:
    """Smooth maximum of two height fields, joined by a valley of about `width`."""
    gap = height - bulge
    higher: Field = (height + bulge + np.sqrt(gap**2 + np.float32(width**2))) * np.float32(0.5)
    return higher


def wall(rng: np.random.Generator, size_px: int) -> Field:
    """The background: a tilted plane with smooth undulation."""
    x, y = pixel_grid(size_px)
    tilt, direction = rng.uniform(0.1, 1.0), rng.uniform(0, 2 * np.pi)
    plane = np.float32(tilt) * (
        np.float32(np.cos(direction)) * x + np.float32(np.sin(direction)) * y
    )
    return plane + undulation(rng, size_px, rng.uniform(0.03, 0.1))


def undulation(rng: np.random.Generator, size_px: int, strength: float) -> Field:
    """Large bulges with successively finer ones on top."""
    cells = rng.uniform(1.2, 3)
    return np.float32(strength) * fractal_noise(rng, size_px, cells, octaves=4, gain=0.38)


def fold(rng: np.random.Generator, size_px: int, radius: Range) -> Field:
    """One bulge: a bent, elongated dome that falls off steeply outside."""
    # A bulge has no fine detail: half the resolution suffices, in a quarter of the time.
    half_px = (size_px + 1) // 2
    half_width = rng.uniform(*radius)
    half_length = half_width * rng.uniform(1, 5)
    distance = bent_ellipse(rng, half_px, half_length, half_width, 0.6)
    roundness = rng.uniform(0.5, 1.0) * half_width
    dome = np.sqrt(np.maximum(1 - distance**2, 0)) - 3 * np.maximum(distance - 1, 0)
    level = np.float32(rng.uniform(-0.12, 0.08)) + undulation(rng, half_px, 0.12 * half_width)
    bulge = np.float32(roundness) * dome + level
    return np.asarray(cv2.resize(bulge, (size_px, size_px), interpolation=cv2.INTER_LINEAR))


def funnel(rng: np.random.Generator, size_px: int) -> Field:
    """A tube that leads away from the endoscope, with a rounded mouth and a wavy wall.

    At distance r from the image's centre a tube of radius R about the optical axis has the depth
    R / r: this is its logarithm, flattened outside the mouth and at the tube's end.
    """
    half_width = rng.uniform(0.15, 0.6)
    distance = bent_ellipse(rng, size_px, half_width * rng.uniform(1, 2), half_width, 0.45)
    quartic = distance**4
    end = np.float32(rng.uniform(0.25, 0.6) ** 4)
    depth = -np.log((quartic + end) / (1 + quartic)) / np.float32(4 * VIEW)
    # Rings or ridges around the tube, evenly spaced in depth.
    steps = rng.uniform(2, 5) * depth + np.float32(0.25) * smooth_noise(rng, size_px, 2.5)
    rings = np.float32(max(rng.uniform(-0.02, 0.02), 0)) * np.sin(np.float32(2 * np.pi) * steps)
    return np.asarray(rings * np.minimum(4 * depth, 1) - depth, np.float32)


def bent_ellipse(
    rng: np.random.Generator, size_px: int, half_length: float, half_width: float, reach: float
) -> Field:
    """Distance from the centre of a random ellipse, bent by noise; 1 on its outline.

    The centre lies at most `reach` from the image's centre along x and y.
    """
    x, y = pixel_grid(size_px)
    bend = rng.uniform(0.1, 0.35) * np.sqrt(half_width)
    x = x - np.float32(rng.uniform(-reach, reach)) + np.float32(bend) * bending(rng, size_px)
    y = y - np.float32(rng.uniform(-reach, reach)) + np.float32(bend) * bending(rng, size_px)
    angle = rng.uniform(0, np.pi)
    cosine, sine = np.float32(np.cos(angle)), np.float32(np.sin(angle))
    along = (cosine * x + sine * y) / np.float32(half_length)
    across = (cosine * y - sine * x) / np.float32(half_width)
    return np.sqrt(along**2 + across**2)


def bending(rng: np.random.Generator, size_px: int) -> Field:
    """A smooth displacement field (S, S)."""
    return smooth_noise(rng, size_px, 1.5) + np.float32(0.25) * smooth_noise(rng, size_px, 4)
