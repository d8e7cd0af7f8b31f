"""Blood and mucus in the hollows of tissue."""

import numpy as np
from numpy.typing import NDArray

from shaftpose.backgrounds.noise import Field, blurred, fractal_noise, smoothstep
from shaftpose.backgrounds.skin import Skin

# Absorption of a deep pool in the red, green and blue channels.
BLOOD = np.array([0.8, 2.9, 3.3], dtype=np.float32)
MUCUS = np.array([0.05, 0.15, 0.5], dtype=np.float32)


def fill_hollows(rng: np.random.Generator, skin: Skin, height: Field) -> Skin:
    """`skin` with a fluid in its deepest hollows; the fluid levels the bumps."""
    size_px = height.shape[0]
    smears = np.float32(rng.uniform(0.005, 0.03)) * fractal_noise(rng, size_px, 3, gain=0.6)
    hollow = blurred(height, 0.08) - height - skin.bumps + smears
    shore = float(np.quantile(hollow[::2, ::2], rng.uniform(0.75, 0.97)))
    deep = smoothstep(hollow, shore, shore + rng.uniform(0.02, 0.08))
    absorbed = BLOOD if rng.random() < 0.6 else MUCUS
    thickness = deep * np.float32(rng.uniform(0.4, 1))
    colour: NDArray[np.float32] = skin.colour * np.exp(-thickness[..., None] * absorbed)
    return Skin(colour, skin.bumps * (1 - np.float32(0.8) * deep))
