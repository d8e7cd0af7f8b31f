"""Compositing of Blender's linear foreground and a background photo, and lens effects."""

from itertools import product
from math import ceil

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.core.images import decode_rgb, encode_jpeg
from shaftpose.core.random_streams import streams
from shaftpose.rendering.scene import Lens

# sRGB to linear for every 8-bit level (IEC 61966-2-1), as a table.
_LEVELS = np.arange(256) / 255.0
_TO_LINEAR = np.where(
    _LEVELS <= 0.04045, _LEVELS / 12.92, ((_LEVELS + 0.055) / 1.055) ** 2.4
).astype(np.float32)
_CLEAN = Lens(blur_px=0.0, haze=0.0, vignette=0.0, noise=0.0)
_HAZE_COLOUR = np.array([214, 208, 204], dtype=np.float32)


def to_linear(rgb: NDArray[np.uint8]) -> NDArray[np.float32]:
    """8-bit sRGB to scene-linear values in [0, 1]."""
    return np.asarray(_TO_LINEAR[rgb], dtype=np.float32)


def to_srgb(linear: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Scene-linear values to 8-bit sRGB; values above 1 are clipped, as in a sensor."""
    clipped = np.clip(linear, 0.0, 1.0)
    curve = np.where(
        clipped <= 0.0031308, 12.92 * clipped, 1.055 * np.power(clipped, 1 / 2.4) - 0.055
    )
    return np.rint(255 * curve).astype(np.uint8)


def composite(
    foreground: NDArray[np.float32], background_rgb: NDArray[np.uint8]
) -> NDArray[np.uint8]:
    """Foreground (h, w, 4), linear and premultiplied, over background (h, w, 3) uint8 sRGB.

    fg + (1 - a) bg in linear light. Pixels without foreground keep the background's bytes.
    """
    rgb = background_rgb.copy()
    touched = foreground[..., 3] > 0
    front, alpha = foreground[touched, :3], foreground[touched, 3:]
    rgb[touched] = to_srgb(front + (1 - alpha) * to_linear(background_rgb[touched]))
    return rgb


def darken(rgb: NDArray[np.uint8], share: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Remove a share (H, W) of an image's (H, W, 3) light; pixels with share 0 are unchanged."""
    return to_srgb(_TO_LINEAR[rgb] * (1 - share[..., None]))


def apply_lens(
    rgb: NDArray[np.uint8],
    lens: Lens,
    sensor_seed: int,
    shown: NDArray[np.bool_] | None = None,
) -> NDArray[np.uint8]:
    """Apply haze, vignette, defocus, motion blur, black outside of `shown` (H, W), sensor noise and
    JPEG compression, in that order. Nothing moves, so boxes, masks and poses stay valid. Without
    any effect the image is returned unchanged."""
    if lens == _CLEAN and shown is None:
        return rgb
    stream = streams(sensor_seed)
    image = rgb.astype(np.float32)
    image += lens.haze * _smoke(stream("smoke"), rgb.shape[0])[..., None] * (_HAZE_COLOUR - image)
    image *= _vignette(rgb.shape[0], lens.vignette)[..., None]
    if lens.blur_px > 0:
        image = np.asarray(cv2.GaussianBlur(image, (0, 0), lens.blur_px), dtype=np.float32)
    if any(lens.motion_px):
        image = np.asarray(cv2.filter2D(image, -1, _way(*lens.motion_px)), dtype=np.float32)
    if shown is not None:
        image[~shown] = 0
    image += lens.noise * stream("noise").standard_normal(image.shape, dtype=np.float32)
    seen = np.clip(np.rint(image), 0, 255).astype(np.uint8)
    return seen if lens.jpeg_quality is None else _compressed(seen, lens.jpeg_quality)


def _way(right_px: float, down_px: float) -> NDArray[np.float32]:
    """Motion blur kernel: a straight line through the centre, so there is no net shift; the sum
    is 1."""
    half = ceil(max(abs(right_px), abs(down_px)) / 2) + 1
    steps = np.linspace(-0.5, 0.5, 16 * half + 1)
    u, v = half + steps * right_px, half + steps * down_px
    kernel = np.zeros((2 * half + 1, 2 * half + 1), dtype=np.float32)
    for column, row in product((0, 1), repeat=2):
        x, y = np.floor(u).astype(int) + column, np.floor(v).astype(int) + row
        np.add.at(kernel, (y, x), (1 - np.abs(u - x)) * (1 - np.abs(v - y)))
    return kernel / kernel.sum()


def _compressed(rgb: NDArray[np.uint8], quality: int) -> NDArray[np.uint8]:
    return np.asarray(decode_rgb(encode_jpeg(rgb, quality)), dtype=np.uint8)


def _smoke(rng: np.random.Generator, size_px: int) -> NDArray[np.float32]:
    """Density (size, size) in [0, 1] of smoke: two octaves of smooth noise."""
    coarse = cv2.resize(rng.random((4, 4), dtype=np.float32), (size_px, size_px),
                        interpolation=cv2.INTER_CUBIC)  # fmt: skip
    fine = cv2.resize(rng.random((9, 9), dtype=np.float32), (size_px, size_px),
                      interpolation=cv2.INTER_CUBIC)  # fmt: skip
    return np.clip(0.7 * coarse + 0.3 * fine, 0, 1)


def _vignette(size_px: int, strength: float) -> NDArray[np.float32]:
    """Factor (size, size): 1 at the centre, 1 - strength in the corners."""
    axis = np.linspace(-1, 1, size_px, dtype=np.float32)
    squared_radius = (axis[:, None] ** 2 + axis[None] ** 2) / 2
    return 1 - np.float32(strength) * squared_radius**2
