"""Lens geometry: the cameras of a set, and the mapping of a pinhole image to them.

Blender renders with a pinhole camera. Distortion and a circular field of view are applied to its
image, to colours and masks alike. The background is a photo and stays unchanged.
"""

from dataclasses import replace
from math import ceil

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.core.errors import InputError
from shaftpose.core.geometry import Camera
from shaftpose.settings.schema import RenderSettings


def camera_with(settings: RenderSettings, k1: float, k2: float) -> Camera:
    """The camera of the settings with the distortion `k1`, `k2`."""
    size_px = settings.camera.size_px
    plain = Camera.from_field_of_view(size_px, size_px, settings.camera.view_deg)
    return replace(plain, k1=k1, k2=k2, field_px=settings.lens.field_px)


def middle_camera(settings: RenderSettings) -> Camera:
    """The camera at the middle of the settings' ranges, for images that do not state a camera."""
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
    plain = replace(camera_with(settings, 0.0, 0.0), field_px=None)
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
