"""The surface of tissue: colour, fibres, fat, vessels, their fine relief, and fluid on it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shaftpose.backgrounds.noise import (
    Field,
    Range,
    blurred,
    fractal_noise,
    lobules,
    smooth_noise,
    smoothstep,
    streaks,
)
from shaftpose.backgrounds.scope import linear
from shaftpose.backgrounds.vessels import blood, vessel_depths

Colour = tuple[int, int, int]
Image = NDArray[np.float32]
# Absorption of a deep pool in the red, green and blue channels.
BLOOD = np.array([0.8, 2.9, 3.3], dtype=np.float32)
MUCUS = np.array([0.05, 0.15, 0.5], dtype=np.float32)


@dataclass(frozen=True)
class SkinLook:
    """Surface parameters of one kind of tissue, sampled for each piece.

    tones: sRGB colours; fat: sRGB colour of fat; fat_chance: probability that a piece is fat;
    vessel_roots: vessel trees per piece; vessel_width: of their roots, in image sides.
    """

    tones: tuple[Colour, ...]
    fat: Colour
    fat_chance: float
    vessel_roots: tuple[int, int]
    vessel_width: Range


@dataclass(frozen=True)
class Skin:
    """Surface of tissue: `colour` (S, S, 3), linear RGB in uniform light, and `bumps` (S, S), its
    fine relief in image sides."""

    colour: Image
    bumps: Field


def palette(rng: np.random.Generator, look: SkinLook) -> Image:
    """Linear colours (3, 3) of one patient's tissue."""
    chosen = rng.choice(np.array(look.tones), 3)
    leading = chosen[0]
    return linear(leading + 0.7 * (chosen - leading) + rng.normal(0, 5, 3))


def make_skin(rng: np.random.Generator, size_px: int, tones: Image, look: SkinLook) -> Skin:
    """One piece of tissue that varies between two of the linear `tones` (3, 3)."""
    grain = rng.uniform(0, np.pi)
    colour = mottled(rng, size_px, tones)
    bumps = pebbles(rng, size_px)
    if rng.random() < look.fat_chance:
        colour, lumps = with_fat(rng, colour, linear(np.array(look.fat)))
        bumps = bumps + lumps
    strands = fibres(rng, size_px, grain)
    vessels = vessel_depths(rng, size_px, grain, look.vessel_roots, look.vessel_width)
    # Strands and shallow vessels rise above the surface.
    bumps = bumps + np.float32(0.006) * strands + np.float32(0.002) * vessels[0]
    colour = colour * np.exp(strands)[..., None] * blood(rng, *vessels)
    # Tissue cannot reflect more light than it receives.
    return Skin(colour / np.maximum(colour.max(axis=-1, keepdims=True), 1), bumps)


def mottled(rng: np.random.Generator, size_px: int, tones: Image) -> Image:
    """Two of the tones (3, 3), blended smoothly, with fine grain on top."""
    first, second = tones[rng.permutation(3)[:2]]
    blend = smoothstep(fractal_noise(rng, size_px, rng.uniform(0.8, 2.5)), -2, 2)[..., None]
    fine = fractal_noise(rng, size_px, rng.uniform(14, 40), octaves=3, gain=0.8)
    grain = np.exp(np.float32(rng.uniform(0.03, 0.09)) * fine)
    mixed: Image = (first + blend * (second - first)) * grain[..., None]
    return mixed


def pebbles(rng: np.random.Generator, size_px: int) -> Field:
    """Fine unevenness of a wet surface, rough in some places and smooth in others."""
    cells = rng.uniform(10, 35)
    rough = smoothstep(smooth_noise(rng, size_px, 2), -1.2, 1.5)
    # Slopes, not heights, are visible, so finer unevenness is lower.
    strength = np.float32(rng.uniform(0.003, 0.03) / cells)
    return strength * rough * fractal_noise(rng, size_px, cells, octaves=3, gain=0.5)


def with_fat(rng: np.random.Generator, colour: Image, fat: Image) -> tuple[Image, Field]:
    """Fat over `colour`, from a thick layer to islands: the colour and the relief of lobules."""
    size_px = colour.shape[0]
    field = fractal_noise(rng, size_px, rng.uniform(1, 2), octaves=4, gain=0.5)
    edge = rng.uniform(-3, 0.5)
    cover = smoothstep(field, edge, edge + 1.5)
    cells = rng.uniform(2, 9)
    lumps = lobules(rng, size_px, cells) + np.float32(0.3) * lobules(rng, size_px, 2.6 * cells)
    lumps = blurred(lumps, rng.uniform(0.02, 0.06) / cells)
    strength = np.float32(rng.uniform(0.6, 0.95)) * cover[..., None]
    shade = np.exp(np.float32(0.12) * (lumps - 1))[..., None]
    mixed = colour + strength * (fat * shade - colour)
    return mixed, np.float32(rng.uniform(0.03, 0.2) / cells) * cover * lumps


def fibres(rng: np.random.Generator, size_px: int, grain: float) -> Field:
    """Lighter and darker strands (S, S) of muscle and membrane along `grain`, around 0."""
    strength = np.float32(0.26 * rng.uniform(0, 1) ** 2)
    bundles = streaks(rng, size_px, grain, rng.uniform(8, 25), rng.uniform(5, 10))
    strands = streaks(rng, size_px, grain, rng.uniform(35, 60), rng.uniform(8, 20))
    hairs = streaks(rng, size_px, grain, rng.uniform(80, 130), rng.uniform(10, 25))
    visible = smoothstep(smooth_noise(rng, size_px, 2), -1, 1.2)
    # Strands follow their bundle: clear where it is strong, faint elsewhere.
    lines = np.float32(0.4) * bundles + (strands + np.float32(0.7) * hairs) * np.exp(
        np.float32(0.5) * bundles - np.float32(0.4)
    )
    return np.asarray(strength * visible * lines, np.float32)


def fill_hollows(rng: np.random.Generator, skin: Skin, height: Field) -> Skin:
    """`skin` with a fluid in its deepest hollows; the fluid levels the bumps."""
    size_px = height.shape[0]
    smears = np.float32(rng.uniform(0.005, 0.03)) * fractal_noise(rng, size_px, 3, gain=0.6)
    hollow = blurred(height, 0.08) - height - skin.bumps + smears
    shore = float(np.quantile(hollow[::2, ::2], rng.uniform(0.75, 0.97)))
    deep = smoothstep(hollow, shore, shore + rng.uniform(0.02, 0.08))
    absorbed = BLOOD if rng.random() < 0.6 else MUCUS
    thickness = deep * np.float32(rng.uniform(0.4, 1))
    colour: Image = skin.colour * np.exp(-thickness[..., None] * absorbed)
    return Skin(colour, skin.bumps * (1 - np.float32(0.8) * deep))
