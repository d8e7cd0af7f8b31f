"""Procedural endoscopic tissue: what an endoscope sees when no instrument is in view.

A height field of folds (`relief`) is given the colours of tissue, vessels, light from the scope,
wet highlights and the softness of a small camera. Colours are linear RGB until `develop`.
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
    streaks,
)
from shaftpose.backgrounds.relief import SURFACES, Range, Relief, make_relief, normals, openness
from shaftpose.backgrounds.vessels import vessel_trees

Colour = tuple[int, int, int]
Image = NDArray[np.float32]
GAMMA = 2.2
# What blood takes from the light in the red, green and blue channels.
SHALLOW_BLOOD = np.array([0.7, 2.1, 1.7], dtype=np.float32)
DEEP_BLOOD = np.array([0.75, 0.85, 0.45], dtype=np.float32)
# What a recess takes from each channel.
SWALLOWED = np.array([2.2, 3.0, 2.9], dtype=np.float32)
# Exponents on the light that faces the surface: less contrast in red, which scatters furthest.
SCATTER = (0.9, 1.2, 1.15)
HIGHLIGHT = np.array([0.93, 0.97, 1.0], dtype=np.float32)


@dataclass(frozen=True)
class TissueLook:
    """What tells one kind of tissue from another. Ranges are drawn from once for each image.

    tones: sRGB colours of tissue; fat: sRGB colour of fat and mucus; fold_radius: half width of
    folds in image sides; vessel_roots: vessel trees on each piece of tissue; vessel_width: of their
    roots in image sides; wet_share: share of the image that is highlight; brightness: mean of the
    finished image, 0 to 1.
    """

    tones: tuple[Colour, ...]
    fat: Colour
    fat_chance: float
    folds: tuple[int, int]
    fold_radius: Range
    cavity_chance: float
    vessel_roots: tuple[int, int]
    vessel_width: Range
    wet_share: Range
    brightness: Range


MUCOSA = TissueLook(
    tones=((226, 128, 112), (208, 92, 78), (234, 158, 138), (176, 60, 58), (222, 122, 84),
           (204, 118, 124), (228, 176, 166), (232, 138, 96), (196, 120, 142), (178, 92, 108)),
    fat=(220, 142, 70),
    fat_chance=0.3,
    folds=(1, 6),
    fold_radius=(0.12, 0.42),
    cavity_chance=0.35,
    vessel_roots=(4, 36),
    vessel_width=(0.003, 0.009),
    wet_share=(0.0004, 0.011),
    brightness=(0.36, 0.58),
)  # fmt: skip

STAND_IN = TissueLook(
    tones=((242, 180, 132), (240, 158, 98), (244, 198, 160), (234, 142, 92), (240, 172, 114)),
    fat=(238, 168, 84),
    fat_chance=0.7,
    folds=(1, 3),
    fold_radius=(0.3, 0.7),
    cavity_chance=0.2,
    vessel_roots=(16, 40),
    vessel_width=(0.005, 0.013),
    wet_share=(0.0004, 0.009),
    brightness=(0.45, 0.62),
)


def render_tissue(
    rng: np.random.Generator, size_px: int, look: TissueLook = MUCOSA
) -> NDArray[np.uint8]:
    """One (size, size, 3) RGB picture of tissue."""
    # Filters see no neighbours beyond the border: a rim is rendered too and cut off.
    rim_px = int(np.ceil(0.02 * size_px))
    canvas_px = size_px + 2 * rim_px
    folds = int(rng.integers(look.folds[0], look.folds[1] + 1))
    cavities = int(rng.integers(1, 3)) if rng.random() < look.cavity_chance else 0
    relief = make_relief(rng, canvas_px, folds, look.fold_radius, cavities)
    colour = albedo(rng, relief, look)
    light, shine = scope_light(rng, relief, rng.uniform(*look.wet_share))
    lit = expose(colour * light, rng.uniform(*look.brightness))
    picture = develop(rng, add_highlights(lit, shine))
    return np.ascontiguousarray(picture[rim_px:-rim_px, rim_px:-rim_px])


def albedo(rng: np.random.Generator, relief: Relief, look: TissueLook) -> Image:
    """(S, S, 3) the colour of the tissue in even light."""
    size_px = relief.height.shape[0]
    tones = palette(rng, look)
    colour = np.zeros((size_px, size_px, 3), dtype=np.float32)
    for number in range(SURFACES):
        shown = (relief.surface == number).astype(np.float32)
        if shown.any():
            # Blurred, since one tissue grows into the next where no step in height parts them.
            colour += blurred(shown, 0.004)[..., None] * piece_of_tissue(rng, size_px, tones, look)
    return colour


def palette(rng: np.random.Generator, look: TissueLook) -> Image:
    """(3, 3) the linear colours that this patient's tissue varies between."""
    chosen = rng.choice(np.array(look.tones), 3)
    leading = chosen[0]
    return linear(leading + 0.6 * (chosen - leading) + rng.normal(0, 5, 3))


def piece_of_tissue(
    rng: np.random.Generator, size_px: int, tones: Image, look: TissueLook
) -> Image:
    """(S, S, 3) the colour of one piece of tissue, its fibres, fat and vessels included."""
    grain = rng.uniform(0, np.pi)
    colour = mottled(rng, size_px, tones)
    if rng.random() < look.fat_chance:
        colour = with_fat(rng, colour, linear(np.array(look.fat)))
    colour *= fibres(rng, size_px, grain)[..., None]
    return colour * blood(rng, size_px, grain, look)


def mottled(rng: np.random.Generator, size_px: int, tones: Image) -> Image:
    """Two tones (of (3, 3)) that run into one another, with fine grain on top."""
    first, second = tones[rng.permutation(3)[:2]]
    blend = smoothstep(fractal_noise(rng, size_px, rng.uniform(0.8, 2.5)), -2, 2)[..., None]
    fine = fractal_noise(rng, size_px, rng.uniform(12, 30), octaves=3, gain=0.8)
    grain = np.exp(np.float32(rng.uniform(0.02, 0.07)) * fine)
    mixed: Image = (first + blend * (second - first)) * grain[..., None]
    return mixed


def with_fat(rng: np.random.Generator, colour: Image, fat: Image) -> Image:
    """Yellowish patches of fat or mucus with uneven edges."""
    field = fractal_noise(rng, colour.shape[0], rng.uniform(1, 2), octaves=5, gain=0.6)
    edge = rng.uniform(-0.8, 1)
    cover = np.float32(rng.uniform(0.3, 0.9)) * smoothstep(field, edge, edge + 1.6)[..., None]
    return np.asarray(colour + cover * (fat - colour), dtype=np.float32)


def fibres(rng: np.random.Generator, size_px: int, grain: float) -> Field:
    """A factor near 1: the lighter and darker strands of muscle and membrane."""
    strength = np.float32(rng.uniform(0, 0.16))
    lines = streaks(rng, size_px, grain, rng.uniform(20, 70), rng.uniform(5, 15))
    visible = smoothstep(smooth_noise(rng, size_px, 3), -0.8, 1)
    return np.asarray(np.exp(strength * lines * visible), np.float32)


def blood(rng: np.random.Generator, size_px: int, grain: float, look: TissueLook) -> Image:
    """(S, S, 3) the share of light that vessels and reddened places let through."""
    roots = int(rng.integers(look.vessel_roots[0], look.vessel_roots[1] + 1))
    width = rng.uniform(*look.vessel_width)
    shallow = vessel_trees(rng, size_px, roots, width, grain)
    deep = blurred(vessel_trees(rng, size_px, 3, 2 * width, grain), rng.uniform(0.004, 0.01))
    # A vessel shows only where it runs close beneath the surface.
    shallow *= smoothstep(smooth_noise(rng, size_px, 3), -1.2, 0.6)
    shallow = np.float32(rng.uniform(0.6, 1.3)) * blurred(shallow, rng.uniform(0.0015, 0.004))
    patches = fractal_noise(rng, size_px, rng.uniform(1.5, 4), octaves=5, gain=0.65)
    flush = np.float32(rng.uniform(0, 0.7)) * smoothstep(patches, 0, 2.6)
    red = (shallow + flush)[..., None] * SHALLOW_BLOOD
    blue = np.float32(0.6) * deep[..., None] * DEEP_BLOOD
    return np.asarray(np.exp(-red - blue), np.float32)


def scope_light(rng: np.random.Generator, relief: Relief, wet_share: float) -> tuple[Image, Field]:
    """Light (S, S, 3) that falls on the tissue, and (S, S) the shine of its wet film."""
    distance = rng.uniform(0.3, 0.8) + float(relief.height.max())
    x, y = pixel_grid(relief.height.shape[0])
    to_eye = np.stack([-x, -y, distance - relief.height], axis=-1)
    # The light guide sits beside the lens.
    offset = np.array([*rng.normal(0, 0.25, 2), 0], dtype=np.float32)
    to_light = to_eye + offset
    length = np.linalg.norm(to_light, axis=-1)
    light = diffuse(normals(relief.height), to_light / length[..., None])
    light *= ((distance / length) ** 2 * openness(relief.height))[..., None]
    # Little of the light that enters a recess comes out again, and that is red.
    light *= np.exp(-(relief.cavity**2)[..., None] * SWALLOWED)
    return light, wet_shine(rng, relief, to_eye, to_light, wet_share)


def diffuse(normal: Image, to_light: Image) -> Image:
    """Lambert's law, softened: light that enters tissue comes out again nearby, red most."""
    facing = np.sum(normal * to_light, axis=-1)
    facing = np.clip((facing + np.float32(0.35)) / np.float32(1.35), 0.03, 1)
    return np.stack([facing**power for power in SCATTER], axis=-1)


def wet_shine(
    rng: np.random.Generator, relief: Relief, to_eye: Image, to_light: Image, share: float
) -> Field:
    """(S, S) in [0, 1]: mirror images of the lamp, broken up by the ripples of a wet film."""
    size_px = relief.height.shape[0]
    half = unit(to_eye) + unit(to_light)
    ripples = np.float32(rng.uniform(0.0015, 0.004)) * fractal_noise(
        rng, size_px, rng.uniform(6, 22), octaves=3, gain=0.4
    )
    mirror = np.sum(normals(relief.height + ripples) * unit(half), axis=-1)
    mirror += np.float32(0.02) * smooth_noise(rng, size_px, 3) - np.float32(0.3) * relief.cavity
    peak, edge = np.quantile(mirror[::2, ::2], [1 - 0.3 * share, 1 - share])
    return smoothstep(mirror, float(edge) - 0.012, max(float(peak), float(edge) + 0.004))


def unit(vectors: Image) -> Image:
    """Vectors (..., 3) at length 1."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True), np.float32)


def expose(lit: Image, brightness: float) -> Image:
    """Scaled as the camera's automatic exposure does, bright parts rolled off."""
    target = brightness**GAMMA
    scaled = lit * np.float32(target / max(float(lit.mean()), 1e-6))
    return np.asarray(1 - np.exp(-scaled * (1 + np.float32(0.3) * scaled)), np.float32)


def add_highlights(lit: Image, shine: Field) -> Image:
    """Bluish white highlights with a faint bloom around them."""
    glow = shine + np.float32(0.35) * blurred(shine, 0.006) + np.float32(0.3) * blurred(shine, 0.03)
    return np.asarray(lit + glow[..., None] * HIGHLIGHT, np.float32)


def develop(rng: np.random.Generator, linear_image: Image) -> NDArray[np.uint8]:
    """(S, S, 3) uint8 sRGB: lens softness, gamma and sensor noise."""
    size_px = linear_image.shape[0]
    soft = cv2.GaussianBlur(linear_image, (0, 0), rng.uniform(0.0015, 0.004) * size_px)
    encoded = 255 * np.clip(soft, 0, 1) ** np.float32(1 / GAMMA)
    noise = rng.standard_normal(encoded.shape, dtype=np.float32)
    encoded += np.float32(rng.uniform(0.5, 2.5)) * cv2.GaussianBlur(noise, (0, 0), 0.6)
    return np.asarray(np.clip(np.round(encoded), 0, 255), np.uint8)


def linear(colours: NDArray[np.float64]) -> Image:
    """(..., 3) linear RGB in [0, 1] of sRGB colours in 0 to 255."""
    return np.asarray((np.clip(colours, 0, 255) / 255) ** GAMMA, np.float32)
