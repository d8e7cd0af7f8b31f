"""A straightforward renderer as baseline: `python -m benchmarks.rendering.plain_bpy SET`.

SET is a folder with the description of a rendered set and the scenes of its first images; the
images are written there. Blender's defaults are kept, including denoiser and adaptive sampling,
except for 64 samples: every full frame is rendered on all cores, written as PNG, and rendered
again, flat white, for its mask. Mesh, materials, light and poses are the project's. Seconds per
image go to `plain.json`.
"""

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import bpy
import numpy as np

from benchmarks.rendering.scenes import read_first_scenes
from shaftpose.core.geometry import ShaftPose
from shaftpose.farm.set_folder import read_set
from shaftpose.rendering.materials import GlowMaterial, SteelMaterial
from shaftpose.rendering.meshes import Mesh
from shaftpose.rendering.optics import pinhole_behind
from shaftpose.rendering.scene import Light, Scene, Steel
from shaftpose.rendering.shapes import instrument_shape
from shaftpose.rendering.surroundings import kelvin_to_rgb, lamp_places, room_half_mm, room_mesh
from shaftpose.settings.schema import RenderSettings

_SAMPLES = 64
_FLIP = np.diag([1.0, -1.0, -1.0, 1.0])  # Blender's camera looks along -z with y up


def main() -> None:
    """Render the images and record the seconds of each."""
    folder = Path(sys.argv[1])
    rendered = read_set(folder)
    studio = build(rendered.settings)
    seconds = []
    scenes = read_first_scenes(folder)
    show(studio, scenes[0], rendered.settings)
    write(studio, folder / "first")  # warm-up
    for number, scene in enumerate(scenes):
        start = perf_counter()
        show(studio, scene, rendered.settings)
        write(studio, folder / f"{number:06d}")
        seconds.append(perf_counter() - start)
    (folder / "plain.json").write_text(json.dumps(seconds))


@dataclass(frozen=True)
class Studio:
    """The objects shared by all images."""

    lamps: list[Any]
    room: Any
    glow: GlowMaterial
    white: Any


def build(settings: RenderSettings) -> Studio:
    """Set up camera, lamps and the room of background images."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.resolution_x = scene.render.resolution_y = settings.camera.size_px
    camera = bpy.data.cameras.new("scope")
    camera.angle = np.radians(settings.camera.view_deg)
    scene.camera = add("scope", camera)
    glow = GlowMaterial.create("background")
    pinhole = pinhole_behind(settings)
    room = add("room", mesh_data(room_mesh(room_half_mm(settings, pinhole)), glow.material))
    white = bpy.data.materials.new("white")
    white.use_nodes = True
    shader = white.node_tree.nodes["Principled BSDF"]
    shader.inputs["Emission Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    shader.inputs["Emission Strength"].default_value = 1.0
    lamps = [add_lamp(x_mm, y_mm) for x_mm, y_mm in lamp_places(settings.scene)]
    return Studio(lamps, room, glow, white)


def add_lamp(x_mm: float, y_mm: float) -> Any:
    """A light guide next to the lens."""
    data = bpy.data.lights.new("light guide", "AREA")
    data.shape, data.size = "DISK", 1.5
    lamp = add("light guide", data)
    lamp.location = (x_mm, y_mm, 0.0)
    return lamp


def show(studio: Studio, scene: Scene, settings: RenderSettings) -> None:
    """Replace background, light and shafts by those of one image."""
    studio.glow.apply(bpy.data.images.load(str(scene.background)), scene.light.ambient)
    for lamp in studio.lamps:
        light(lamp, scene.light, len(studio.lamps))
    for shaft in [thing for thing in bpy.data.objects if thing.name.startswith("shaft")]:
        bpy.data.objects.remove(shaft)
    for pose, steel in zip(scene.shafts, scene.steels, strict=True):
        add_shaft(pose, steel, instrument_shape(settings.shaft).mesh)


def light(lamp: Any, wanted: Light, lamps: int) -> None:
    """Set one of `lamps` lamps."""
    lamp.data.energy = wanted.strength / lamps
    lamp.data.color = kelvin_to_rgb(wanted.kelvin)


def add_shaft(pose: ShaftPose, steel: Steel, mesh: Mesh) -> None:
    """A new shaft at its pose."""
    material = SteelMaterial.create("steel")
    material.apply(steel)
    data = mesh_data(mesh, material.material)
    data.polygons.foreach_set("use_smooth", [len(face.vertices) <= 4 for face in data.polygons])
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = pose.rotation, pose.tip_mm
    add("shaft", data).matrix_world = (_FLIP @ matrix).T.tolist()


def mesh_data(mesh: Mesh, material: Any) -> Any:
    """A mesh with texture coordinates and one material."""
    data = bpy.data.meshes.new("mesh")
    data.from_pydata(mesh.vertices.tolist(), [], mesh.faces)
    data.uv_layers.new().data.foreach_set("uv", mesh.uv.astype(np.float32).ravel())
    data.materials.append(material)
    return data


def add(name: str, data: Any) -> Any:
    """A new object in the scene."""
    thing = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def write(studio: Studio, path: Path) -> None:
    """Render the image, then the mask of all shafts: white on black, at one sample."""
    scene, layer = bpy.context.scene, bpy.context.view_layer
    scene.cycles.samples, scene.cycles.use_denoising = _SAMPLES, True
    scene.render.filepath = str(path.with_suffix(".png"))
    bpy.ops.render.render(write_still=True)
    studio.room.hide_render, layer.material_override = True, studio.white
    scene.cycles.samples, scene.cycles.use_denoising = 1, False
    scene.render.filepath = str(path.with_suffix(".mask.png"))
    bpy.ops.render.render(write_still=True)
    studio.room.hide_render, layer.material_override = False, None


if __name__ == "__main__":
    main()
