"""Background augmentation: altered hue, saturation and brightness (paper, II)."""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Range = tuple[float, float]


@dataclass(frozen=True)
class Variation:
    """A shift of the hue in degrees, and factors on saturation and brightness."""

    hue_deg: float
    saturation: float
    brightness: float


UNALTERED = Variation(hue_deg=0.0, saturation=1.0, brightness=1.0)


@dataclass(frozen=True)
class VariationRanges:
    """The lowest and highest value of each part of a `Variation`."""

    hue_deg: Range
    saturation: Range
    brightness: Range


def sample_variation(rng: np.random.Generator, ranges: VariationRanges) -> Variation:
    """A variation drawn uniformly from `ranges`."""
    return Variation(
        hue_deg=rng.uniform(*ranges.hue_deg),
        saturation=rng.uniform(*ranges.saturation),
        brightness=rng.uniform(*ranges.brightness),
    )


def sample_variations(
    rng: np.random.Generator, count: int, ranges: VariationRanges
) -> Iterator[Variation]:
    """`count` variations, the first of which changes nothing."""
    yield UNALTERED
    for _ in range(count - 1):
        yield sample_variation(rng, ranges)


def vary_colour(
    image: NDArray[np.uint8], hue_deg: float, saturation: float, brightness: float
) -> NDArray[np.uint8]:
    """The RGB image (H, W, 3) with its hue shifted and its saturation and brightness scaled."""
    # In float32, because OpenCV's 8-bit hue has only 180 steps, which cause banding.
    hsv = cv2.cvtColor(image.astype(np.float32) / np.float32(255), cv2.COLOR_RGB2HSV)
    hsv[..., 0] = (hsv[..., 0] + hue_deg) % 360
    hsv[..., 1] = np.clip(hsv[..., 1] * saturation, 0, 1)
    hsv[..., 2] = np.clip(hsv[..., 2] * brightness, 0, 1)
    varied: NDArray[np.uint8] = np.round(255 * cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB)).astype(
        np.uint8
    )
    return varied
