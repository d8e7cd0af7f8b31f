"""Blood vessels: meandering, tapering trees drawn on a canvas."""

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.backgrounds.noise import Field

# Vessels are drawn at this scale and shrunk, so that capillaries are thinner than a pixel.
OVERSAMPLING = 2
STEP = 0.006
FINEST_WIDTH = 0.0012
# Smoothing kernel of a vessel's bends, in steps.
BEND = np.hanning(11)[1:-1] / 2


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
