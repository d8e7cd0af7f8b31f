"""The device that Cycles renders on."""

import logging
from typing import Any

import bpy

logger = logging.getLogger(__name__)


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
