"""Compositing of Blender's linear foreground and a background photo, on which shafts cast a shadow.

The soft shadow on the tissue behind shafts is computed here, because that tissue exists only as a
photo.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.core.geometry import Camera, ShaftPose

# sRGB to linear for every 8-bit level (IEC 61966-2-1), as a table.
_LEVELS = np.arange(256) / 255.0
_TO_LINEAR = np.where(
    _LEVELS <= 0.04045, _LEVELS / 12.92, ((_LEVELS + 0.055) / 1.055) ** 2.4
).astype(np.float32)
_GAP_MM = 6.0  # from a tip to the tissue behind it
_LAMP_MM = 3.0  # half width of the light: the lamp, and light reflected by nearby tissue
# Distances in px between a point and its shadow, for a lamp 1 mm from the lens.
_PARALLAXES = 2.0 ** np.arange(-1, 6)


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


def contact_shadow(
    camera: Camera,
    shafts: Sequence[tuple[ShaftPose, NDArray[np.bool_]]],
    lamps_mm: Sequence[tuple[float, float]],
) -> NDArray[np.float32]:
    """The share (H, W), 0 to 1, of its light that the tissue around shafts loses.

    shafts: poses and masks (H, W); lamps_mm: x and y of the scope's lamps relative to the lens.

    The tissue behind a shaft is taken for a plane across the view, at a depth d just beyond the
    tip. A lamp b mm from the lens displaces the shadow of a point at depth z by f b (1/z - 1/d) px.
    The lamp's width blurs it: it is narrow and dark near the tip, wide and faint near the handle.
    """
    layers = np.zeros((len(_PARALLAXES), camera.height, camera.width), dtype=np.float32)
    for pose, mask in shafts:
        near = _inverse_depth(camera, pose)[mask] * (pose.z_mm + _GAP_MM)  # d / z
        parallax = camera.focal_px / (pose.z_mm + _GAP_MM) * (near - 1)
        octave = np.log2(np.clip(parallax, _PARALLAXES[0], _PARALLAXES[-1]) / _PARALLAXES[0])
        for number, layer in enumerate(layers):
            layer[mask] += np.clip(1 - np.abs(octave - number), 0, 1) / near
    shadow = np.zeros(layers.shape[1:], dtype=np.float32)
    for layer, parallax in zip(layers, _PARALLAXES.tolist(), strict=True):
        if layer.any():
            blurred = cv2.GaussianBlur(layer, (0, 0), _LAMP_MM * parallax)
            for x_mm, y_mm in lamps_mm:
                shadow += _moved(blurred, -x_mm * parallax, -y_mm * parallax) / len(lamps_mm)
    # Half of a blurred shadow is behind the edge that casts it.
    return np.minimum(2 * shadow, 1)


def _inverse_depth(camera: Camera, pose: ShaftPose) -> NDArray[np.float64]:
    """1 / z (H, W), in 1 / mm, of the plane through a shaft's axis that most faces the camera."""
    normal = np.cross(pose.direction, np.cross(pose.direction, pose.tip_mm))
    inverse: NDArray[np.float64] = camera.rays() @ normal / (pose.tip_mm @ normal)
    return inverse


def _moved(image: NDArray[np.float32], right_px: float, down_px: float) -> NDArray[np.float32]:
    way = np.array([[1, 0, right_px], [0, 1, down_px]])
    # The shaft and its shadow continue beyond the image.
    moved = cv2.warpAffine(image, way, image.shape[::-1], borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(moved, dtype=np.float32)
