"""The device that Cycles renders on, and what happens where there is none of its kind.

The processes of these tests are shown no GPU."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest
from blender_process import run_python

from shaftpose.config import RenderSettings

SEED = 11

RENDER = """
import logging, os
os.environ.update(CUDA_VISIBLE_DEVICES="", HIP_VISIBLE_DEVICES="")
logging.basicConfig(filename="warnings.txt", level=logging.WARNING, format="%(message)s")
import bpy
from shaftpose.rendering.generator import Generator
sources = {Path(path): source for path, source in backgrounds}
sample = Generator(settings, sources, seed).sample(0)
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
    """The bytes of image 0, rendered in a process, and the warnings given."""
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
