"""Blood vessels: meandering, tapering trees drawn on a canvas, and the light they absorb."""

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.backgrounds.noise import (
    Field,
    Range,
    blurred,
    fractal_noise,
    smooth_noise,
    smoothstep,
)

# Vessels are drawn at this scale and shrunk, so that capillaries are thinner than a pixel.
OVERSAMPLING = 2
STEP = 0.006
FINEST_WIDTH = 0.0012
# Absorption of blood in the red, green and blue channels.
SHALLOW_BLOOD = np.array([0.7, 2.1, 1.7], dtype=np.float32)
DEEP_BLOOD = np.array([0.75, 0.85, 0.45], dtype=np.float32)
# Smoothing kernel of a vessel's bends, in steps.
BEND = np.hanning(11)[1:-1] / 2


def vessel_depths(
    rng: np.random.Generator, size_px: int, grain: float, roots: tuple[int, int], widths: Range
) -> tuple[Field, Field]:
    """Amounts of blood (S, S) in shallow vessels and in deep ones, which are blurred.

    roots, widths: ranges of the number and the width of the shallow vessels' roots.
    """
    count = int(rng.integers(roots[0], roots[1] + 1))
    width = rng.uniform(*widths)
    shallow = vessel_trees(rng, size_px, count, width, grain)
    # A vessel is visible only where it is close to the surface.
    shallow *= smoothstep(smooth_noise(rng, size_px, 3), -1.4, 0.6)
    shallow = np.float32(rng.uniform(0.5, 1.4)) * blurred(shallow, rng.uniform(0.001, 0.003))
    deep = vessel_trees(rng, size_px, 2, 2 * width, grain)
    return shallow, blurred(deep, rng.uniform(0.004, 0.012))


def blood(rng: np.random.Generator, shallow: Field, deep: Field) -> NDArray[np.float32]:
    """Share of light (S, S, 3) transmitted by vessels and reddened areas."""
    size_px = shallow.shape[0]
    patches = fractal_noise(rng, size_px, rng.uniform(1, 3), octaves=5, gain=0.6)
    flush = np.float32(0.6 * rng.uniform(0, 1) ** 2) * smoothstep(patches, -1, 2.6)
    red = (shallow + flush)[..., None] * SHALLOW_BLOOD
    blue = np.float32(0.5) * deep[..., None] * DEEP_BLOOD
    return np.asarray(np.exp(-red - blue), np.float32)


def vessel_trees(
    rng: np.random.Generator, size_px: int, roots: int, width: float, grain: float
) -> Field:
    """Amount of blood (S, S) in [0, 1] in the light's path.

    width: of the roots, in image sides; grain: approximate direction of the roots, in radians.
    """
    canvas = np.zeros((OVERSAMPLING * size_px, OVERSAMPLING * size_px), dtype=np.uint8)
    for _ in range(roots):
        start = rng.uniform(-0.1, 1.1, 2)
        heading = grain + rng.normal(0, 0.45)
        thickest = width * rng.uniform(0.25, 1)
        # A vessel rises and descends again: it is thickest where it is nearest.
        _grow(rng, canvas, start, heading, rng.uniform(0.1, 0.8), thickest)
        _grow(rng, canvas, start, heading + np.pi, rng.uniform(0.1, 0.8), thickest)
    shrunk = cv2.resize(canvas, (size_px, size_px), interpolation=cv2.INTER_AREA)
    return shrunk.astype(np.float32) / np.float32(255)


def _grow(
    rng: np.random.Generator,
    canvas: NDArray[np.uint8],
    start: NDArray[np.float64],
    heading: float,
    length: float,
    width: float,
) -> None:
    """Draw one vessel and its branches; branches first, so that the stem is on top."""
    path, headings = _meander(rng, start, heading, max(int(length / STEP), 3))
    if width > FINEST_WIDTH:
        for _ in range(rng.integers(2, 4 + int(4 * length))):
            at = int(rng.integers(len(path) // 5, len(path)))
            turn = rng.choice([-1, 1]) * rng.uniform(0.3, 0.9)
            thinner = width * (1 - 0.6 * at / len(path)) * rng.uniform(0.4, 0.75)
            shorter = length * rng.uniform(0.2, 0.6)
            _grow(rng, canvas, path[at], headings[at] + turn, shorter, thinner)
    _draw(canvas, path, width)


def _meander(
    rng: np.random.Generator, start: NDArray[np.float64], heading: float, steps: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """A winding path (steps, 2) and its headings (steps,) in radians."""
    drift = np.cumsum(rng.normal(0, 0.05, steps))
    winding = rng.uniform(0.1, 0.5)
    wiggle = np.convolve(rng.normal(0, winding, steps + 8), BEND, mode="valid")
    headings = heading + drift + wiggle
    moves = STEP * np.stack([np.cos(headings), np.sin(headings)], axis=1)
    return start + np.cumsum(moves, axis=0), headings


def _draw(canvas: NDArray[np.uint8], path: NDArray[np.float64], width: float) -> None:
    """Draw the path as a line whose width, then strength, tapers towards the end."""
    side = canvas.shape[0]
    points = np.round(path * side * 16).astype(np.int32)
    pieces = min(10, len(points) // 6 + 1)
    cuts = np.linspace(0, len(points) - 1, pieces + 1).astype(int)
    for piece in reversed(range(pieces)):
        wide = width * side * (1 - 0.85 * piece / pieces)
        strength = int(255 * min(1.0, 0.15 + 0.4 * wide))
        line = [points[cuts[piece] : cuts[piece + 1] + 1]]
        cv2.polylines(canvas, line, False, (strength,), max(1, round(wide)), cv2.LINE_AA, shift=4)
