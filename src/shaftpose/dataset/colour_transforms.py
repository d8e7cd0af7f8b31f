"""Random colour changes and noise for training images; boxes and poses stay valid.

Each transform takes an image (H, W, 3) uint8 RGB and a generator and returns a new image.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.core.images import Image
from shaftpose.settings.schema import Range

# NTSC luma and chroma: in the chroma plane, hue is an angle and saturation a length.
_RGB_TO_YIQ = np.array(
    [[0.299, 0.587, 0.114], [0.5959, -0.2746, -0.3213], [0.2115, -0.5227, 0.3112]]
)
_YIQ_TO_RGB = np.linalg.inv(_RGB_TO_YIQ)
_MID_GREY = 128.0


@dataclass(frozen=True)
class ColourJitter:
    """Random brightness, contrast, saturation and hue (paper, data augmentation).

    brightness: added, in grey levels; contrast, saturation: factors; hue_deg: rotation.
    """

    brightness: Range
    contrast: Range
    saturation: Range
    hue_deg: Range

    def __call__(self, rgb: Image, rng: np.random.Generator) -> Image:
        """Apply all four as one affine map of the colours, clipped once."""
        matrix = colour_matrix(
            brightness=float(rng.uniform(*self.brightness)),
            contrast=float(rng.uniform(*self.contrast)),
            saturation=float(rng.uniform(*self.saturation)),
            hue_deg=float(rng.uniform(*self.hue_deg)),
        )
        return np.asarray(cv2.transform(rgb, matrix), dtype=np.uint8)


def colour_matrix(
    brightness: float, contrast: float, saturation: float, hue_deg: float
) -> NDArray[np.float64]:
    """(3, 4) affine map of RGB: hue turned and saturation scaled in YIQ, then contrast about mid
    grey, then brightness."""
    turn = np.radians(hue_deg)
    in_yiq = np.eye(3)
    in_yiq[1:, 1:] = saturation * np.array(
        [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    )
    linear = contrast * _YIQ_TO_RGB @ in_yiq @ _RGB_TO_YIQ
    offset = brightness + (1 - contrast) * _MID_GREY
    return np.column_stack([linear, np.full(3, offset)])


@dataclass(frozen=True)
class UniformNoise:
    """Uniform noise on every pixel and channel of a share of the images (paper, IV-A).

    half_width: in grey levels; probability: share of the images.
    """

    half_width: int
    probability: float = 0.5

    def __call__(self, rgb: Image, rng: np.random.Generator) -> Image:
        """The image with noise, or the image itself."""
        if rng.random() >= self.probability:
            return rgb
        noise = rng.integers(-self.half_width, self.half_width + 1, rgb.shape, dtype=np.int16)
        return np.asarray(cv2.add(rgb, noise, dtype=cv2.CV_8U), dtype=np.uint8)
