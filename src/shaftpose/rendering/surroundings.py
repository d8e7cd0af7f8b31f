"""The scope and the tissue around it in Blender: camera, light guides and the cube of background.

1 Blender unit is 1 mm. Blender's camera looks along -z with y up.
"""

from pathlib import Path
from typing import Any

import bpy
import numpy as np

from shaftpose.core.geometry import Camera
from shaftpose.core.images import read_written
from shaftpose.rendering.materials import GlowMaterial, SceneImages, mirrored_image
from shaftpose.rendering.meshes import Mesh
from shaftpose.rendering.placed_bodies import blender_mesh
from shaftpose.rendering.scene import Light
from shaftpose.rendering.shapes import instrument_shape
from shaftpose.settings.schema import RenderSettings, SceneSettings

_LEAST_ROOM_MM = 60.0  # half edge of the cube with the background
_LAMP_MM = 2.0  # from the lens to a light guide
_RING_LAMPS = 8
_LAMP_SIZE_MM = 1.5


class Surroundings:
    """Camera, light guides, and the cube of background images around them, in Blender's scene."""

    def __init__(self, scene: Any, settings: RenderSettings, pinhole: Camera) -> None:
        _add_camera(scene, pinhole)
        self._lamps = [_add_lamp(scene, *place) for place in lamp_places(settings.scene)]
        self._glow = _add_room(scene, room_half_mm(settings, pinhole))

    def show(self, background: Path, light: Light, images: SceneImages) -> Any:
        """Surround the scope with an image file, and set its light; returns the file's image."""
        reflected = images.add(mirrored_image(read_written(background)))
        self._glow.apply(reflected, light.ambient)
        for lamp in self._lamps:
            lamp.data.energy = light.strength / len(self._lamps)
            lamp.data.color = kelvin_to_rgb(light.kelvin)
        return images.add(bpy.data.images.load(str(background.resolve())))


def kelvin_to_rgb(kelvin: float) -> tuple[float, float, float]:
    """Linear RGB of a black body, brightest channel 1.

    Linear interpolation between 3,000 K, 6,500 K and 10,000 K: this covers endoscope lamps, and
    finer differences do not show on metal.
    """
    known = np.array([3000.0, 6500.0, 10000.0])
    red, green, blue = np.array([[1.0, 1.0, 0.62], [0.45, 1.0, 0.75], [0.15, 1.0, 1.0]])
    channels = [float(np.interp(kelvin, known, channel)) for channel in (red, green, blue)]
    return channels[0], channels[1], channels[2]


def _add_camera(scene: Any, pinhole: Camera) -> None:
    data = bpy.data.cameras.new("scope")
    data.sensor_fit = "HORIZONTAL"
    data.angle = 2 * np.arctan(pinhole.width / (2 * pinhole.focal_px))
    data.clip_start, data.clip_end = 0.1, 1000.0
    camera = bpy.data.objects.new("scope", data)
    scene.collection.objects.link(camera)
    scene.camera = camera


def lamp_places(scene: SceneSettings) -> list[tuple[float, float]]:
    """x and y of the light guides around the lens, mm."""
    if scene.light_shape == "twin":
        return [(-_LAMP_MM, 0.0), (_LAMP_MM, 0.0)]
    angles = 2 * np.pi * np.arange(_RING_LAMPS) / _RING_LAMPS
    return [(_LAMP_MM * float(np.cos(a)), _LAMP_MM * float(np.sin(a))) for a in angles]


def _add_lamp(scene: Any, x_mm: float, y_mm: float) -> Any:
    data = bpy.data.lights.new("light guide", "AREA")
    data.shape, data.size = "DISK", _LAMP_SIZE_MM
    lamp = bpy.data.objects.new("light guide", data)
    lamp.location = (x_mm, y_mm, 0.0)
    lamp.visible_camera = False
    scene.collection.objects.link(lamp)
    return lamp


def room_half_mm(settings: RenderSettings, pinhole: Camera) -> float:
    """Half edge of the cube with the background (paper, training dataset).

    No visible part of a shaft may pierce it. Visible parts are within the field of view, and no
    farther away than the farthest tip, or than a handle that points away from the camera.
    """
    away = max(0.0, -float(np.cos(np.radians(settings.poses.pitch_deg[1]))))
    farthest = settings.poses.z_mm[1] + away * instrument_shape(settings.shaft).length_mm
    across = farthest * max(1.0, pinhole.width / (2 * pinhole.focal_px))
    return max(_LEAST_ROOM_MM, 1.2 * across)


def _add_room(scene: Any, half_mm: float) -> GlowMaterial:
    """The cube of background images around camera and shafts, invisible to the camera."""
    glow = GlowMaterial.create("background")
    mesh = blender_mesh("room", room_mesh(half_mm), smooth=False)
    mesh.materials[0] = glow.material
    room = bpy.data.objects.new("room", mesh)
    room.visible_camera = room.visible_shadow = False
    scene.collection.objects.link(room)
    return glow


def room_mesh(half_mm: float) -> Mesh:
    """A cube around the camera in Blender's axes; each face shows the whole background, the one in
    front of the camera (-z) in the camera's orientation."""
    corners = half_mm * np.array(
        [[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], dtype=np.float64
    )
    faces = ((0, 1, 3, 2), (5, 4, 6, 7), (4, 0, 2, 6), (1, 5, 7, 3), (4, 5, 1, 0), (2, 3, 7, 6))
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1]] * 6, dtype=np.float64)
    return Mesh(corners, faces, uv)
