"""The device that Cycles renders on, and the fallback if it is missing.

GPUs are hidden from the processes of these tests: rendering on one is not tested."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest

from shaftpose.settings.schema import RenderSettings
from tests.rendering.blender_process import run_python

SEED = 11

RENDER = """
import logging, os
os.environ.update(CUDA_VISIBLE_DEVICES="", HIP_VISIBLE_DEVICES="")
logging.basicConfig(filename="warnings.txt", level=logging.WARNING, format="%(message)s")
import bpy
from shaftpose.rendering.generator import SampleGenerator
sources = {Path(path): source for path, source in backgrounds}
sample = SampleGenerator(settings, sources, seed).sample(0)
assert bpy.context.scene.cycles.device == "CPU"
Path("image.rgb").write_bytes(sample.rgb.tobytes())
"""


@pytest.fixture(scope="module")
def on_the_cpu(
    settings: RenderSettings,
    backgrounds: Mapping[Path, str],
    tmp_path_factory: pytest.TempPathFactory,
) -> bytes:
    folder = tmp_path_factory.mktemp("cpu")
    image, warnings = render(folder, settings, backgrounds)
    assert warnings == ""
    return image


def render(
    folder: Path, settings: RenderSettings, backgrounds: Mapping[Path, str]
) -> tuple[bytes, str]:
    """The bytes of image 0, rendered in a process, and the logged warnings."""
    pairs = [(str(path), source) for path, source in backgrounds.items()]
    run_python(RENDER, folder, settings, backgrounds=pairs, seed=SEED)
    return (folder / "image.rgb").read_bytes(), (folder / "warnings.txt").read_text()


@pytest.mark.parametrize("device", ["cuda", "metal"])
def test_without_the_device_a_warning_names_it_and_the_cpu_renders(
    settings: RenderSettings,
    backgrounds: Mapping[Path, str],
    on_the_cpu: bytes,
    tmp_path: Path,
    device: str,
) -> None:
    image, warnings = render(tmp_path, replace(settings, device=device), backgrounds)
    assert warnings.splitlines() == [
        f"render.device: Blender finds no {device} device here: the CPU renders"
    ]
    assert image == on_the_cpu


CHOOSE = """
import os
os.environ.update(CUDA_VISIBLE_DEVICES="", HIP_VISIBLE_DEVICES="")
import bpy, _cycles  # in this order: the second is part of the first
from shaftpose.rendering.cycles import use_device
found = _cycles.available_devices
_cycles.available_devices = lambda kind: (
    ("a GPU", "CUDA", "CUDA_0", *found(kind)[0][3:]), *found(kind)
)
use_device(bpy.context.scene, "cuda")
preferences = bpy.context.preferences.addons["cycles"].preferences
assert bpy.context.scene.cycles.device == "GPU"
assert preferences.compute_device_type == "CUDA"
assert {d.type: d.use for d in preferences.devices} == {"CUDA": True, "CPU": False}
"""


def test_a_device_that_blender_names_is_chosen_without_the_cpu_beside_it(
    settings: RenderSettings, tmp_path: Path
) -> None:
    """Blender's own preferences, with one device added to the machine's list."""
    run_python(CHOOSE, tmp_path, settings)
