"""The endoscope in front of tissue: its light, and its camera.

The light: shading, fall-off and wet highlights. The camera: automatic exposure, focus, sensor and
sharpening.
"""

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
from shaftpose.backgrounds.relief import VIEW

Image = NDArray[np.float32]
GAMMA = 2.2
SMOKE = np.array([0.22, 0.26, 0.29], dtype=np.float32)
HIGHLIGHT = np.array([0.93, 0.97, 1.0], dtype=np.float32)
Vectors = NDArray[np.float32]
# Exponents of the diffuse term: less contrast in red, which scatters furthest.
SCATTER = (0.85, 1.4, 1.3)
# Distance that red light travels below the surface, in image sides; other colours far less.
SCATTER_LENGTH = 0.004
# Widths of creases in image sides and how much they darken. Wide hollows darken little, because
# the light comes from the viewpoint.
CREASES = ((0.02, 0.4), (0.06, 0.35), (0.16, 0.12))


def scope_light(rng: np.random.Generator, height: Field, wet_share: float) -> tuple[Vectors, Field]:
    """The light (S, S, 3) on the tissue, and the shine (S, S) of its wet film."""
    depth = np.exp(np.float32(-VIEW) * height)
    x, y = (np.float32(VIEW) * ticks for ticks in pixel_grid(height.shape[0]))
    to_eye = -depth[..., None] * np.stack([x, y, -np.ones_like(x)], axis=-1)
    # The light guide is next to the lens.
    to_light = to_eye + np.array([*rng.normal(0, 0.12, 2), 0], dtype=np.float32)
    square = np.sum(to_light**2, axis=-1)
    light = diffuse(normals(height), unit(to_light)) * (openness(height) / square)[..., None]
    return light, wet_shine(rng, height, unit(to_eye) + unit(to_light), square, wet_share)


def normals(height: Field) -> Vectors:
    """Unit normals (S, S, 3) in perspective, z towards the endoscope.

    At depth exp(-h) on the viewing ray (u, v, 1) the surface has the normal
    (-h_u, -h_v, 1 - u h_u - v h_v).
    """
    slope_y, slope_x = np.gradient(height, 1 / height.shape[0])
    x, y = pixel_grid(height.shape[0])
    forward = 1 - np.float32(VIEW) * (x * slope_x + y * slope_y)
    return unit(np.stack([-slope_x, -slope_y, forward], axis=-1))


def diffuse(normal: Vectors, to_light: Vectors) -> Vectors:
    """Lambert's law, softened by subsurface scattering, which is strongest in red."""
    facing = np.sum(normal * to_light, axis=-1)
    facing = np.clip((facing + np.float32(0.3)) / np.float32(1.3), 0.03, 1)
    red = blurred(facing, SCATTER_LENGTH)
    return np.stack([red ** SCATTER[0], facing ** SCATTER[1], facing ** SCATTER[2]], axis=-1)


def openness(height: Field) -> Field:
    """Share of light that reaches a point, in (0, 1]: low in creases and below folds."""
    shut = sum(
        np.float32(weight / sigma) * np.maximum(blurred(height, sigma) - height, 0)
        for sigma, weight in CREASES
    )
    return np.exp(-shut).astype(np.float32)


def wet_shine(
    rng: np.random.Generator, height: Field, half: Vectors, square: Field, share: float
) -> Field:
    """Reflections (S, S) of the lamp, broken up by the ripples of a wet film; 1 saturates.

    A GGX lobe. half: directions halfway between eye and lamp, of any length; square: squared
    distances to the lamp; share: of the image that saturates.
    """
    size_px = height.shape[0]
    cells = rng.uniform(3, 18)
    ripples = np.float32(rng.uniform(0.01, 0.04) / cells) * fractal_noise(
        rng, size_px, cells, octaves=3, gain=0.5
    )
    mirror = np.clip(np.sum(normals(height + ripples) * unit(half), axis=-1), 0, 1)
    roughness = np.float32(rng.uniform(0.08, 0.2) ** 4)
    lobe = (roughness / (mirror**2 * (roughness - 1) + 1)) ** 2 / roughness
    # The film is patchy, and reflects less light far from the lamp.
    lobe *= np.exp(np.float32(1.2) * smooth_noise(rng, size_px, 3)) / square
    edge = float(np.quantile(lobe[::2, ::2], 1 - share))
    glints = np.minimum(lobe / np.float32(max(edge, 1e-6)), 4)
    return glints + sheen(rng, mirror, square)


def sheen(rng: np.random.Generator, mirror: Field, square: Field) -> Field:
    """A pale, wide and weak gloss on moist tissue that is close to and faces the lamp."""
    gloss = blurred(mirror, 0.006) ** np.float32(rng.uniform(4, 16)) / square
    return np.float32(0.25 * rng.uniform(0, 1) ** 2 / float(gloss.max())) * gloss


def unit(vectors: Vectors) -> Vectors:
    """Vectors (..., 3) scaled to length 1."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True), np.float32)


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
