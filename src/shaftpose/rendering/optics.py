"""The lens: the cameras of a set, the mapping of a pinhole's image to them, and effects on images.

Blender renders with a pinhole camera. Distortion and a circular field of view are applied to its
image, to colours and masks alike. The background is a photo and stays unchanged.
"""

from dataclasses import replace
from itertools import product
from math import ceil

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.core.errors import InputError
from shaftpose.core.geometry import Camera
from shaftpose.core.images import decode_rgb, encode_jpeg
from shaftpose.core.random_streams import streams
from shaftpose.rendering.scene import Lens
from shaftpose.settings.schema import RenderSettings

_CLEAN = Lens(blur_px=0.0, haze=0.0, vignette=0.0, noise=0.0)
_HAZE_COLOUR = np.array([214, 208, 204], dtype=np.float32)


def camera_with(settings: RenderSettings, k1: float, k2: float) -> Camera:
    """The camera of the settings with the distortion `k1`, `k2`."""
    size_px = settings.camera.size_px
    plain = Camera.from_field_of_view(size_px, size_px, settings.camera.view_deg)
    return replace(plain, k1=k1, k2=k2, field=plain.disc(settings.lens.field_px))


def middle_camera(settings: RenderSettings) -> Camera:
    """The camera in the middle of the settings' ranges, for images that do not state theirs."""
    distortion = settings.lens.distortion
    return camera_with(settings, sum(distortion.k1) / 2, sum(distortion.k2) / 2)


def pinhole_behind(settings: RenderSettings) -> Camera:
    """The pinhole camera to render with: the settings' focal length, and an image large enough for
    every distortion within their ranges.

    Raises InputError if a distortion is so strong that part of the image stays empty.
    """
    # The lower k1 and k2, the farther out a corner's ray points.
    (k1, _), (k2, _) = settings.lens.distortion.k1, settings.lens.distortion.k2
    shown = np.isfinite(camera_with(settings, 0.0, 0.0).rays()[..., 0])
    rays = camera_with(settings, k1, k2).rays()[shown]
    if not np.all(np.isfinite(rays)):
        raise InputError(
            f"params.yaml: lens.distortion: k1 = {k1:g} with k2 = {k2:g} leaves corners of the "
            f"image empty at camera.view_deg = {settings.camera.view_deg:g}; raise k1 or k2, or "
            "set lens.field_px"
        )
    plain = replace(camera_with(settings, 0.0, 0.0), field=None)
    # From the principal point to the farthest pixel's outer edge; 1e-6 px absorbs rounding.
    reach_px = plain.focal_px * float(np.abs(rays[:, :2]).max()) + 0.5 - 1e-6
    return _with_margin(plain, max(0, ceil(reach_px - plain.width / 2)))


def _with_margin(camera: Camera, margin_px: int) -> Camera:
    return replace(
        camera,
        width=camera.width + 2 * margin_px,
        height=camera.height + 2 * margin_px,
        cx=camera.cx + margin_px,
        cy=camera.cy + margin_px,
    )


def seen_by(
    camera: Camera, pinhole: Camera, linear: NDArray[np.float32], index: NDArray[np.int64]
) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Map a pinhole's whole image to `camera`.

    linear: (H, W, 4) colours, interpolated; index: (H, W) object numbers up to 32,767, of the
    nearest pixel. Both are 0 outside the camera's field of view.
    """
    # OpenCV counts from the first pixel's centre. -9 is outside the image, so it maps to 0.
    source = np.nan_to_num(pinhole.project(camera.rays()) - 0.5, nan=-9.0).astype(np.float32)
    u, v = source[..., 0], source[..., 1]
    colours = cv2.remap(linear, u, v, cv2.INTER_LINEAR)
    objects = cv2.remap(index.astype(np.int16), u, v, cv2.INTER_NEAREST)
    return np.asarray(colours, dtype=np.float32), objects.astype(np.int64)


def apply_lens(
    rgb: NDArray[np.uint8],
    lens: Lens,
    sensor_seed: int,
    shown: NDArray[np.bool_] | None = None,
) -> NDArray[np.uint8]:
    """Apply the effects of air, lens, sensor and recorder, in this order: haze, vignette, defocus,
    motion blur, a black surround, noise, JPEG compression.

    shown: mask (H, W) of the round field of view, None if the whole image shows. Nothing moves, so
    boxes, masks and poses stay valid. Without any effect the image is returned unchanged.
    """
    if lens == _CLEAN and shown is None:
        return rgb
    stream = streams(sensor_seed)
    image = rgb.astype(np.float32)
    image += lens.haze * _smoke(stream("smoke"), rgb.shape[0])[..., None] * (_HAZE_COLOUR - image)
    image *= _vignette(rgb.shape[0], lens.vignette)[..., None]
    if lens.blur_px > 0:
        image = np.asarray(cv2.GaussianBlur(image, (0, 0), lens.blur_px), dtype=np.float32)
    if any(lens.motion_px):
        image = np.asarray(
            cv2.filter2D(image, -1, _motion_kernel(*lens.motion_px)), dtype=np.float32
        )
    if shown is not None:
        image[~shown] = 0
    image += lens.noise * stream("noise").standard_normal(image.shape, dtype=np.float32)
    seen = np.clip(np.rint(image), 0, 255).astype(np.uint8)
    return seen if lens.jpeg_quality is None else _compressed(seen, lens.jpeg_quality)


def _motion_kernel(right_px: float, down_px: float) -> NDArray[np.float32]:
    """A straight line through the kernel's centre, so nothing moves on the whole; its sum is 1."""
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
