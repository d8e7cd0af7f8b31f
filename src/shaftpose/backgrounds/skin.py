"""The surface of tissue: colour, fibres, fat, vessels and their fine relief."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shaftpose.backgrounds.exposure import linear
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
from shaftpose.backgrounds.vessels import vessel_trees

Colour = tuple[int, int, int]
Image = NDArray[np.float32]
# Absorption of blood in the red, green and blue channels.
SHALLOW_BLOOD = np.array([0.7, 2.1, 1.7], dtype=np.float32)
DEEP_BLOOD = np.array([0.75, 0.85, 0.45], dtype=np.float32)


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
    """colour: (S, S, 3) linear RGB in uniform light; bumps: (S, S) fine relief in image sides."""

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
    vessels = vessel_depths(rng, size_px, grain, look)
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


def vessel_depths(
    rng: np.random.Generator, size_px: int, grain: float, look: SkinLook
) -> tuple[Field, Field]:
    """Shallow vessels, and deep vessels, which are blurred; (S, S) each."""
    roots = int(rng.integers(look.vessel_roots[0], look.vessel_roots[1] + 1))
    width = rng.uniform(*look.vessel_width)
    shallow = vessel_trees(rng, size_px, roots, width, grain)
    # A vessel is visible only where it is close to the surface.
    shallow *= smoothstep(smooth_noise(rng, size_px, 3), -1.4, 0.6)
    shallow = np.float32(rng.uniform(0.5, 1.4)) * blurred(shallow, rng.uniform(0.001, 0.003))
    deep = vessel_trees(rng, size_px, 2, 2 * width, grain)
    return shallow, blurred(deep, rng.uniform(0.004, 0.012))


def blood(rng: np.random.Generator, shallow: Field, deep: Field) -> Image:
    """Share of light (S, S, 3) transmitted by vessels and reddened areas."""
    size_px = shallow.shape[0]
    patches = fractal_noise(rng, size_px, rng.uniform(1, 3), octaves=5, gain=0.6)
    flush = np.float32(0.6 * rng.uniform(0, 1) ** 2) * smoothstep(patches, -1, 2.6)
    red = (shallow + flush)[..., None] * SHALLOW_BLOOD
    blue = np.float32(0.5) * deep[..., None] * DEEP_BLOOD
    return np.asarray(np.exp(-red - blue), np.float32)
