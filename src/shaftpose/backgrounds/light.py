"""Light from the endoscope's tip on a relief: shading, fall-off and the highlights of its film."""

import numpy as np
from numpy.typing import NDArray

from shaftpose.backgrounds.noise import Field, blurred, fractal_noise, pixel_grid, smooth_noise
from shaftpose.backgrounds.relief import VIEW

Vectors = NDArray[np.float32]
# Exponents on the light that faces the surface: less contrast in red, which scatters furthest.
SCATTER = (0.85, 1.4, 1.3)
# How far light travels beneath the surface, in image sides, in red; the other colours far less.
SCATTER_LENGTH = 0.004
# Widths of creases in image sides and how much they darken. Wide hollows do so little: the light
# comes from where the eye is.
CREASES = ((0.02, 0.4), (0.06, 0.35), (0.16, 0.12))


def scope_light(rng: np.random.Generator, height: Field, wet_share: float) -> tuple[Vectors, Field]:
    """Light (S, S, 3) that falls on the tissue, and (S, S) the shine of its wet film."""
    depth = np.exp(np.float32(-VIEW) * height)
    x, y = (np.float32(VIEW) * ticks for ticks in pixel_grid(height.shape[0]))
    to_eye = -depth[..., None] * np.stack([x, y, -np.ones_like(x)], axis=-1)
    # The light guide sits beside the lens.
    to_light = to_eye + np.array([*rng.normal(0, 0.12, 2), 0], dtype=np.float32)
    square = np.sum(to_light**2, axis=-1)
    light = diffuse(normals(height), unit(to_light)) * (openness(height) / square)[..., None]
    return light, wet_shine(rng, height, unit(to_eye) + unit(to_light), square, wet_share)


def normals(height: Field) -> Vectors:
    """(S, S, 3) unit normals in perspective, z towards the endoscope.

    With depth exp(-h) at the viewing ray (u, v, 1) the surface's tangents span a plane with the
    normal (-h_u, -h_v, 1 - u h_u - v h_v).
    """
    slope_y, slope_x = np.gradient(height, 1 / height.shape[0])
    x, y = pixel_grid(height.shape[0])
    forward = 1 - np.float32(VIEW) * (x * slope_x + y * slope_y)
    return unit(np.stack([-slope_x, -slope_y, forward], axis=-1))


def diffuse(normal: Vectors, to_light: Vectors) -> Vectors:
    """Lambert's law, softened: light that enters tissue comes out again nearby, red most."""
    facing = np.sum(normal * to_light, axis=-1)
    facing = np.clip((facing + np.float32(0.3)) / np.float32(1.3), 0.03, 1)
    red = blurred(facing, SCATTER_LENGTH)
    return np.stack([red ** SCATTER[0], facing ** SCATTER[1], facing ** SCATTER[2]], axis=-1)


def openness(height: Field) -> Field:
    """How much light reaches a place, in (0, 1]: low in creases and beneath overhanging folds."""
    shut = sum(
        np.float32(weight / sigma) * np.maximum(blurred(height, sigma) - height, 0)
        for sigma, weight in CREASES
    )
    return np.exp(-shut).astype(np.float32)


def wet_shine(
    rng: np.random.Generator, height: Field, half: Vectors, square: Field, share: float
) -> Field:
    """(S, S) mirror images of the lamp, broken up by the ripples of a wet film; 1 saturates.

    The GGX lobe about the direction halfway between eye and lamp; `share` of the image saturates.
    """
    size_px = height.shape[0]
    cells = rng.uniform(3, 18)
    ripples = np.float32(rng.uniform(0.01, 0.04) / cells) * fractal_noise(
        rng, size_px, cells, octaves=3, gain=0.5
    )
    mirror = np.clip(np.sum(normals(height + ripples) * unit(half), axis=-1), 0, 1)
    roughness = np.float32(rng.uniform(0.08, 0.2) ** 4)
    lobe = (roughness / (mirror**2 * (roughness - 1) + 1)) ** 2 / roughness
    # The film is not everywhere, and far from the lamp it mirrors less light.
    lobe *= np.exp(np.float32(1.2) * smooth_noise(rng, size_px, 3)) / square
    edge = float(np.quantile(lobe[::2, ::2], 1 - share))
    glints = np.minimum(lobe / np.float32(max(edge, 1e-6)), 4)
    return glints + sheen(rng, mirror, square)


def sheen(rng: np.random.Generator, mirror: Field, square: Field) -> Field:
    """The pale gloss, wide and weak, of moist tissue that is near and faces the lamp."""
    gloss = blurred(mirror, 0.006) ** np.float32(rng.uniform(4, 16)) / square
    return np.float32(0.25 * rng.uniform(0, 1) ** 2 / float(gloss.max())) * gloss


def unit(vectors: Vectors) -> Vectors:
    """Vectors (..., 3) at length 1."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True), np.float32)
