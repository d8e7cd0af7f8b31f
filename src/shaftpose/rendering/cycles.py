"""Cycles: its settings, its device, and its passes as arrays, without intermediate files.

Python cannot read the pixels of a render from Blender's memory, but a render engine can read its
own result. Cycles is registered from Python, so its `render` method is wrapped: after the original
call the passes are copied. This interface is undocumented; a test compares the passes with the EXR
file that Blender writes.
"""

import logging
from collections.abc import Callable
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from shaftpose.core.geometry import Camera
from shaftpose.rendering.regions import Region

logger = logging.getLogger(__name__)

# Metal reflects the cube after one bounce, and the other shaft's reflections after two.
_BOUNCES = 2
Passes = dict[str, NDArray[np.float32]]


def set_up_cycles(scene: Any, size_px: int, most_samples: int) -> None:
    """Set all that decides pixels, and what makes small renders fast.

    Each image takes the first samples, `sample_subset_length`, of a pattern for `most_samples`. If
    `samples` itself changed, Cycles would keep the longest pattern so far, and an image would
    depend on those before it.
    """
    scene.render.engine = "CYCLES"
    scene.render.resolution_x = scene.render.resolution_y = size_px
    scene.render.resolution_percentage = 100
    scene.render.film_transparent = True
    scene.render.use_persistent_data = True
    scene.render.dither_intensity = 0.0
    scene.render.use_compositing = scene.render.use_sequencer = False
    scene.render.threads_mode, scene.render.threads = "FIXED", 1
    scene.view_settings.view_transform = "Standard"
    scene.view_layers[0].use_pass_object_index = True
    cycles = scene.cycles
    cycles.seed = 0
    cycles.use_light_tree = False  # made for many lights; here the lamps are the only ones
    cycles.samples, cycles.use_adaptive_sampling = most_samples, False
    cycles.use_sample_subset, cycles.sample_offset = True, 0
    cycles.use_denoising = cycles.use_auto_tile = False
    cycles.max_bounces = cycles.glossy_bounces = _BOUNCES
    cycles.diffuse_bounces, cycles.transmission_bounces = 1, 0
    cycles.volume_bounces = cycles.transparent_max_bounces = 0


def use_device(scene: Any, name: str) -> None:
    """Let Cycles render on all devices of a kind: cpu, cuda, optix, hip or metal.

    If Blender finds none, log a warning and render on the CPU.
    """
    scene.cycles.device = "CPU"
    if name == "cpu":
        return
    kind = name.upper()
    preferences = bpy.context.preferences.addons["cycles"].preferences
    # Blender also lists the CPU as a helper; mixing two kinds would not be reproducible.
    devices = [d for d in preferences.get_devices_for_type(kind) if d.type == kind]
    if not devices:
        logger.warning("render.device: Blender finds no %s device here: the CPU renders", name)
        return
    preferences.compute_device_type = kind
    for device in preferences.devices:
        device.use = device in devices
    scene.cycles.device = "GPU"


def set_border(scene: Any, region: Region, camera: Camera) -> None:
    """Render only `region`; bit-identical to the same pixels of a full frame."""
    render = scene.render
    render.use_border = render.use_crop_to_border = True
    # Blender rounds border fractions down to pixels; a quarter pixel guards against 2.9999.
    render.border_min_x = (region.x0 + 0.25) / camera.width
    render.border_max_x = (region.x1 + 0.25) / camera.width
    render.border_min_y = (camera.height - region.y1 + 0.25) / camera.height
    render.border_max_y = (camera.height - region.y0 + 0.25) / camera.height


class PassReader:
    """Renders the current scene and returns its passes; at most one reader per process."""

    def __init__(self) -> None:
        self._passes: Passes = {}
        engine = _cycles_engine()
        engine.render = self._wrapped(engine.render)

    def render(self) -> Passes:
        """Pass name -> (h, w, channels) float32, top row first, of the border's size."""
        self._passes = {}
        bpy.ops.render.render()
        if not self._passes:
            raise RuntimeError("Blender rendered nothing; see its message above")
        return self._passes

    def _wrapped(self, original: Callable[..., Any]) -> Callable[..., Any]:
        def render(engine: Any, depsgraph: Any) -> None:
            original(engine, depsgraph)
            self._passes = _copy_passes(engine.get_result())

        return render


def _cycles_engine() -> Any:
    for engine in bpy.types.RenderEngine.__subclasses__():
        if getattr(engine, "bl_idname", None) == "CYCLES":
            return engine
    raise RuntimeError("Blender was built without Cycles; install bpy from PyPI")


def _copy_passes(result: Any) -> Passes:
    height, width = result.resolution_y, result.resolution_x
    passes = {}
    for render_pass in result.layers[0].passes:
        flat = np.empty(width * height * render_pass.channels, dtype=np.float32)
        render_pass.rect.foreach_get(flat)
        passes[render_pass.name] = flat.reshape(height, width, -1)[::-1]
    return passes
