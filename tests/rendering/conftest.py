"""Fixtures of the rendering tests. Blender holds one scene per process: tests in this process share
one SampleGenerator, all others use separate processes."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from shaftpose.core.geometry import Camera
from shaftpose.core.images import write_jpeg
from shaftpose.core.samples import Sample
from shaftpose.settings.parsing import parse
from shaftpose.settings.schema import RenderSettings

if TYPE_CHECKING:
    from shaftpose.rendering.generator import SampleGenerator

ROOT = Path(__file__).parents[2]
SEED = 11
IMAGES = 10


@pytest.fixture(scope="session")
def settings() -> RenderSettings:
    """The repository's settings at one to four samples."""
    values = yaml.safe_load((ROOT / "params.yaml").read_text())
    parts = {name: values[name] for name in ("camera", "poses", "shaft", "scene", "lens")}
    quality = {"samples": (1, 4), "jpeg_quality": values["render"]["jpeg_quality"]}
    return parse(RenderSettings, parts | quality, "params.yaml: ")


@pytest.fixture(scope="session")
def with_scene(settings: RenderSettings) -> Callable[..., RenderSettings]:
    """A function that replaces some scene settings of `settings`."""
    return lambda **changed: replace(settings, scene=replace(settings.scene, **changed))


@pytest.fixture(scope="session")
def camera(settings: RenderSettings) -> Camera:
    size = settings.camera.size_px
    return Camera.from_field_of_view(size, size, settings.camera.view_deg)


@pytest.fixture(scope="session")
def backgrounds(
    settings: RenderSettings, tmp_path_factory: pytest.TempPathFactory
) -> Mapping[Path, str]:
    """Three reddish images of gradients and noise -> the ids of their sources."""
    folder = tmp_path_factory.mktemp("backgrounds")
    rng = np.random.default_rng(3)
    found = {}
    for number in range(3):
        path = folder / f"background-{number}.jpg"
        write_jpeg(_photo(rng, settings.camera.size_px), path)
        found[path] = f"source-{number}"
    return found


def _photo(rng: np.random.Generator, size_px: int) -> NDArray[np.uint8]:
    slope = np.linspace(0, 1, size_px)
    mix = rng.random(3)
    grey = mix[0] * slope[:, None] + mix[1] * slope[None] + 0.2 * rng.random((size_px, size_px))
    colour = np.array([150, 70, 60]) * (0.5 + 0.5 * mix)
    photo: NDArray[np.uint8] = np.clip(40 + grey[..., None] * colour, 0, 255).astype(np.uint8)
    return photo


@pytest.fixture(scope="session")
def occluded_settings(with_scene: Callable[..., RenderSettings]) -> RenderSettings:
    """Tissue in front of the shafts in half of the images, so that both kinds occur."""
    return with_scene(occluder_probability=0.5)


@pytest.fixture(scope="session")
def generator(
    occluded_settings: RenderSettings, backgrounds: Mapping[Path, str]
) -> "SampleGenerator":
    """The only SampleGenerator, and thus the only Blender scene, of this process."""
    from shaftpose.rendering.generator import SampleGenerator

    return SampleGenerator(occluded_settings, backgrounds, SEED)


@pytest.fixture(scope="session")
def samples(generator: "SampleGenerator") -> list[Sample]:
    """Images 0 .. IMAGES - 1 of the generator, rendered in this order."""
    return [generator.sample(index) for index in range(IMAGES)]
