"""The shape of procedural tissue: a wall, the folds and bulges before it, and cavities in it.

Lengths are in image sides; height grows towards the endoscope.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.backgrounds.noise import (
    Field,
    blurred,
    fractal_noise,
    pixel_grid,
    smooth_noise,
    smoothstep,
)

Range = tuple[float, float]
# Pieces of different tissue in one image, the wall included.
SURFACES = 3


@dataclass(frozen=True)
class Relief:
    """height: (S, S) float32; surface: (S, S) uint8 below SURFACES, which piece of tissue each
    pixel shows (0 is the wall); cavity: (S, S) float32 in [0, 1], 1 inside a dark recess."""

    height: Field
    surface: NDArray[np.uint8]
    cavity: Field


def make_relief(
    rng: np.random.Generator, size_px: int, folds: int, fold_radius: Range, cavities: int
) -> Relief:
    """A wall with `folds` bulges before it; nearer tissue hides what lies behind."""
    height = wall(rng, size_px)
    surface = np.zeros((size_px, size_px), dtype=np.uint8)
    cavity = np.zeros_like(height)
    for _ in range(cavities):
        cavity = np.maximum(cavity, recess(rng, size_px))
    height -= np.float32(rng.uniform(0.2, 0.6)) * cavity
    for _ in range(folds):
        bulge = fold(rng, size_px, fold_radius)
        # A fold that rises well out of a recess lies in the light again.
        cavity *= 1 - smoothstep(bulge - height, 0, 0.15)
        if rng.random() < 0.5:
            height = melted(height, bulge, rng.uniform(0.02, 0.12))
        else:
            surface[bulge > height] = rng.integers(1, SURFACES)
            height = melted(height, bulge, 0.004)
    # A touch of blur turns cut edges into the rounded ones of soft tissue.
    return Relief(blurred(height, 0.004), surface, cavity)


def melted(height: Field, bulge: Field, width: float) -> Field:
    """The higher of the two, joined by a smooth valley of about `width`."""
    gap = height - bulge
    higher: Field = (height + bulge + np.sqrt(gap**2 + np.float32(width**2))) * np.float32(0.5)
    return higher


def wall(rng: np.random.Generator, size_px: int) -> Field:
    """The background: a tilted plane with slow undulation."""
    x, y = pixel_grid(size_px)
    tilt, direction = rng.uniform(0.1, 1.2), rng.uniform(0, 2 * np.pi)
    plane = np.float32(tilt) * (
        np.float32(np.cos(direction)) * x + np.float32(np.sin(direction)) * y
    )
    return plane + undulation(rng, size_px, rng.uniform(0.03, 0.1))


def undulation(rng: np.random.Generator, size_px: int, strength: float) -> Field:
    """Large swellings with ever finer ones on them."""
    cells = rng.uniform(1.2, 3)
    return np.float32(strength) * fractal_noise(rng, size_px, cells, octaves=4, gain=0.38)


def fold(rng: np.random.Generator, size_px: int, radius: Range) -> Field:
    """One bulge: a bent, elongated dome that falls off steeply outside."""
    # A bulge has no fine detail: half the resolution does, at a quarter of the time.
    half_px = (size_px + 1) // 2
    half_width = rng.uniform(*radius)
    half_length = half_width * rng.uniform(1, 4)
    distance = bent_ellipse(rng, half_px, half_length, half_width)
    roundness = rng.uniform(0.5, 1.0) * half_width
    dome = np.sqrt(np.maximum(1 - distance**2, 0)) - 3 * np.maximum(distance - 1, 0)
    level = np.float32(rng.uniform(-0.12, 0.08)) + undulation(rng, half_px, 0.12 * half_width)
    bulge = np.float32(roundness) * dome + level
    return np.asarray(cv2.resize(bulge, (size_px, size_px), interpolation=cv2.INTER_LINEAR))


def recess(rng: np.random.Generator, size_px: int) -> Field:
    """A hole with soft walls, 1 at its bottom."""
    half_width = rng.uniform(0.07, 0.2)
    distance = bent_ellipse(rng, size_px, half_width * rng.uniform(1, 3), half_width)
    return 1 - smoothstep(distance, 0.1, 1.3)


def bent_ellipse(
    rng: np.random.Generator, size_px: int, half_length: float, half_width: float
) -> Field:
    """Distance from a random point in units of the ellipse's radius, space bent by noise."""
    x, y = pixel_grid(size_px)
    bend = rng.uniform(0.1, 0.35) * np.sqrt(half_width)
    x = x - np.float32(rng.uniform(-0.6, 0.6)) + np.float32(bend) * bending(rng, size_px)
    y = y - np.float32(rng.uniform(-0.6, 0.6)) + np.float32(bend) * bending(rng, size_px)
    angle = rng.uniform(0, np.pi)
    cosine, sine = np.float32(np.cos(angle)), np.float32(np.sin(angle))
    along = (cosine * x + sine * y) / np.float32(half_length)
    across = (cosine * y - sine * x) / np.float32(half_width)
    return np.sqrt(along**2 + across**2)


def bending(rng: np.random.Generator, size_px: int) -> Field:
    """A smooth displacement (S, S) that bends straight forms."""
    return smooth_noise(rng, size_px, 1.5) + np.float32(0.25) * smooth_noise(rng, size_px, 4)


def normals(height: Field) -> NDArray[np.float32]:
    """(S, S, 3) unit normals of a height field, z towards the endoscope."""
    slope_y, slope_x = np.gradient(height, 1 / height.shape[0])
    length = np.sqrt(slope_x**2 + slope_y**2 + 1)
    normal = np.stack([-slope_x, -slope_y, np.ones_like(length)], axis=-1) / length[..., None]
    return np.asarray(normal, dtype=np.float32)


def openness(height: Field) -> Field:
    """How much light reaches a place, in (0, 1]: low in creases and beneath overhanging folds."""
    shut = sum(
        np.maximum(blurred(height, sigma) - height, 0) / np.float32(sigma)
        for sigma in (0.02, 0.06, 0.16)
    )
    return np.exp(np.float32(-0.4) * shut).astype(np.float32)
