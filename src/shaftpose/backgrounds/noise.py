"""Smooth random fields, the basis of procedural tissue.

All fields are (size, size) float32 with a standard deviation of about one. `cells` is the number of
noise cells along an image's side, so a field looks the same at every size.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

Field = NDArray[np.float32]
Range = tuple[float, float]
# Of `smooth_noise`, in samples: the width of its blur and the margin cropped afterwards.
BLUR = 1.3
MARGIN = 4


def smooth_noise(rng: np.random.Generator, size_px: int, cells: float) -> Field:
    """One octave: white noise, blurred at about three samples per cell and enlarged.

    The blur, not the interpolation, shapes the blobs, so no grid is visible.
    """
    samples = min(3 * cells, size_px)
    side = int(np.ceil(samples))
    # The margin removes the blur's mirrored border, which would look like folds at the edges.
    padded = (side + 2 * MARGIN, side + 2 * MARGIN)
    white = rng.standard_normal(padded, dtype=np.float32)
    grid = cv2.GaussianBlur(white, (0, 0), BLUR)[MARGIN - 1 : 1 - MARGIN, MARGIN - 1 : 1 - MARGIN]
    grid = grid * np.float32(2 * BLUR * np.sqrt(np.pi))
    # One more sample on each side, cropped later: the interpolation is flat at its ends.
    extra_px = int(np.ceil(size_px / side))
    full_px = size_px + 2 * extra_px
    whole = cv2.resize(grid, (full_px, full_px), interpolation=cv2.INTER_CUBIC)
    return np.ascontiguousarray(whole[extra_px:-extra_px, extra_px:-extra_px])


def fractal_noise(
    rng: np.random.Generator, size_px: int, cells: float, octaves: int = 4, gain: float = 0.5
) -> Field:
    """Sum of octaves of `smooth_noise`, each twice as fine and `gain` times as strong."""
    total = smooth_noise(rng, size_px, cells)
    for octave in range(1, octaves):
        total += np.float32(gain**octave) * smooth_noise(rng, size_px, cells * 2**octave)
    return total


def streaks(
    rng: np.random.Generator, size_px: int, angle: float, cells: float, stretch: float
) -> Field:
    """Fibres along `angle` (radians), `stretch` times as long as wide, bent by smooth noise."""
    canvas_px = 2 * size_px
    shape = (int(2 * cells), max(int(2 * cells / stretch), 3))
    grid = rng.standard_normal(shape).astype(np.float32)
    straight = cv2.resize(grid, (canvas_px, canvas_px), interpolation=cv2.INTER_CUBIC)
    x, y = pixel_grid(size_px)
    bend = np.float32(0.06) * fractal_noise(rng, size_px, 1.5, octaves=3, gain=0.4)
    along = np.float32(np.cos(angle)) * x + np.float32(np.sin(angle)) * y
    across = np.float32(np.cos(angle)) * y - np.float32(np.sin(angle)) * x + bend
    scale = np.float32(size_px)
    return sample(np.asarray(straight, np.float32), (along + 1) * scale, (across + 1) * scale)


def lobules(rng: np.random.Generator, size_px: int, cells: float) -> Field:
    """Adjacent rounded cells, `cells` along a side: 1 at their centres, lower at their borders.

    Based on the distance to the nearest random centre (Worley's F1), distorted by noise.
    """
    side_px = size_px + size_px // 4
    free = np.full((side_px, side_px), 255, dtype=np.uint8)
    across = int(np.ceil(1.25 * cells))
    ticks = np.arange(across)
    centres = np.stack(np.meshgrid(ticks, ticks), axis=-1) + rng.uniform(0, 1, (across, across, 2))
    column, row = np.clip(centres * size_px / cells, 0, side_px - 1).astype(int).reshape(-1, 2).T
    free[row, column] = 0
    distance = cv2.distanceTransform(free, cv2.DIST_L2, 5) * np.float32(1.3 * cells / size_px)
    x, y = pixel_grid(size_px)
    bend = np.float32(0.2 / cells)
    x_px = (x + bend * smooth_noise(rng, size_px, 1.2 * cells)) * size_px + side_px / 2
    y_px = (y + bend * smooth_noise(rng, size_px, 1.2 * cells)) * size_px + side_px / 2
    return 1 - sample(np.asarray(distance**2, np.float32), x_px, y_px)


def sample(field: Field, x_px: Field, y_px: Field) -> Field:
    """`field` at fractional pixel positions, mirrored at its borders."""
    found = cv2.remap(field, x_px, y_px, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101)
    return np.asarray(found, dtype=np.float32)


def pixel_grid(size_px: int) -> tuple[Field, Field]:
    """x and y of the pixel centres in image sides, zero at the image's centre."""
    ticks = ((np.arange(size_px) + 0.5) / size_px - 0.5).astype(np.float32)
    x, y = np.meshgrid(ticks, ticks)
    return x, y


def smoothstep(field: Field, low: float, high: float) -> Field:
    """0 below `low`, 1 above `high`, a smooth ramp between."""
    t = np.clip((field - np.float32(low)) / np.float32(high - low), 0, 1)
    return np.asarray(t * t * (3 - 2 * t), dtype=np.float32)


def blurred(field: Field, sigma: float) -> Field:
    """Gaussian blur with `sigma` in image sides; wide blurs are computed on a smaller copy."""
    size_px = field.shape[0]
    shrink = max(1, int(sigma * size_px / 4))
    small_px = max(size_px // shrink, 1)
    small = cv2.resize(field, (small_px, small_px), interpolation=cv2.INTER_AREA)
    small = cv2.GaussianBlur(small, (0, 0), max(sigma * small_px, 0.1))
    return np.asarray(cv2.resize(small, (size_px, size_px), interpolation=cv2.INTER_LINEAR))
