"""The endoscope's camera: automatic exposure, lens, sensor and sharpening."""

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.backgrounds.noise import Field, blurred, fractal_noise, smoothstep

Image = NDArray[np.float32]
GAMMA = 2.2
SMOKE = np.array([0.22, 0.26, 0.29], dtype=np.float32)
HIGHLIGHT = np.array([0.93, 0.97, 1.0], dtype=np.float32)


def linear(colours: NDArray[np.float64]) -> Image:
    """Linear RGB (..., 3) in [0, 1] of sRGB colours in 0 to 255."""
    return np.asarray((np.clip(colours, 0, 255) / 255) ** GAMMA, np.float32)


def expose(lit: Image, brightness: float) -> Image:
    """Scale the image like an automatic exposure, with highlights rolled off."""
    target = brightness**GAMMA
    scaled = lit * np.float32(target / max(float(lit.mean()), 1e-6))
    return np.asarray(1 - np.exp(-scaled * (1 + np.float32(0.3) * scaled)), np.float32)


def smoke(rng: np.random.Generator, lit: Image) -> Image:
    """`lit` behind the thin bluish smoke of electrosurgery; usually hardly any."""
    strength = np.float32(0.7 * rng.uniform(0, 1) ** 20)
    share = strength * smoothstep(fractal_noise(rng, lit.shape[0], 1.5), -3, 2)[..., None]
    return np.asarray(lit + share * (SMOKE - lit), np.float32)


def add_highlights(lit: Image, shine: Field) -> Image:
    """Add bluish white highlights with a faint bloom."""
    glow = shine + np.float32(0.15) * blurred(shine, 0.006) + np.float32(0.1) * blurred(shine, 0.03)
    return np.asarray(lit + glow[..., None] * HIGHLIGHT, np.float32)


def develop(rng: np.random.Generator, linear_image: Image, height: Field) -> NDArray[np.uint8]:
    """(S, S, 3) uint8 sRGB: defocus before and behind one height, gamma, noise, sharpening."""
    # Clipped, so that the lens's softness does not widen the brightest highlights.
    seen = focused(rng, np.minimum(linear_image, 1.5), height)
    encoded = 255 * np.clip(seen, 0, 1) ** np.float32(1 / GAMMA)
    noise = rng.standard_normal(encoded.shape, dtype=np.float32)
    encoded += np.float32(rng.uniform(0.5, 2)) * cv2.GaussianBlur(noise, (0, 0), 0.6)
    detail = encoded - cv2.GaussianBlur(encoded, (0, 0), 1.2)
    encoded += np.float32(0.4 + 3 * rng.uniform(0, 1) ** 2) * detail
    return np.asarray(np.clip(np.round(encoded), 0, 255), np.uint8)


def focused(rng: np.random.Generator, image: Image, height: Field) -> Image:
    """`image` with the lens's softness, which grows with distance from the plane of focus."""
    size_px = image.shape[0]
    sharp = cv2.GaussianBlur(image, (0, 0), rng.uniform(0.0008, 0.002) * size_px)
    soft = cv2.GaussianBlur(sharp, (0, 0), rng.uniform(0.002, 0.01) * size_px)
    focus = height[tuple(rng.integers(0, size_px, 2))]
    share = smoothstep(np.abs(height - focus), 0.15, 0.8)[..., None]
    return np.asarray(sharp + share * (soft - sharp), np.float32)
