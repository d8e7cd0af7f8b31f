"""Image k of a dataset: its scene rendered, composited and annotated."""

from collections.abc import Mapping
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shaftpose.config import RenderSettings
from shaftpose.errors import InputError
from shaftpose.geometry import ShaftPose, cylinder_depth, mask_box
from shaftpose.images import read_rgb
from shaftpose.rendering.blender import Foreground, Renderer
from shaftpose.rendering.compositing import apply_lens, composite
from shaftpose.rendering.scene import Scene, SceneSampler
from shaftpose.shards import Instrument, Sample, sample_key

_MOST_DRAWS = 50


class Generator:
    """Makes samples; sample `index` depends on `(settings, backgrounds, seed, index)` alone.

    backgrounds: image file -> id of its source, in a fixed order.
    """

    def __init__(
        self, settings: RenderSettings, backgrounds: Mapping[Path, str], seed: int
    ) -> None:
        self._settings, self._sources, self._seed = settings, backgrounds, seed
        self._sampler = SceneSampler(settings, tuple(backgrounds), seed)
        self._renderer = Renderer(settings)

    def sample(self, index: int) -> Sample:
        """Image `index` with its annotations."""
        scene, foreground, instruments = self._acceptable(index)
        rgb = read_background(scene.background, self._settings.camera.size_px)
        if foreground is not None:
            where = foreground.region.slices
            rgb[where] = composite(foreground.linear, rgb[where])
        return Sample(
            key=sample_key(index),
            rgb=apply_lens(rgb, scene.lens, scene.sensor_seed),
            instruments=instruments,
            camera=self._renderer.camera,
            facts=self._facts(scene, index),
        )

    def _acceptable(self, index: int) -> tuple[Scene, Foreground | None, tuple[Instrument, ...]]:
        """The first draw that shows enough of every shaft. The sampler saw to that on a coarse
        grid and without occluders, so all but occluded images take the first."""
        least = self._settings.scene.min_visible_px
        for scene in islice(self._sampler.candidates(index), _MOST_DRAWS):
            foreground = self._renderer.render(scene)
            masks = self._masks(scene, foreground)
            if all(mask.sum() >= least for mask in masks):
                found = map(self._instrument, scene.shafts, masks)
                return scene, foreground, tuple(found)
        raise InputError(
            f"image {index}: a shaft shows fewer than scene.min_visible_px = {least} px in each "
            f"of {_MOST_DRAWS} draws; lower it, or scene.occluder_probability, in params.yaml"
        )

    def _masks(self, scene: Scene, foreground: Foreground | None) -> list[NDArray[np.bool_]]:
        """The visible pixels (H, W) of each shaft."""
        camera = self._renderer.camera
        index = np.zeros((camera.height, camera.width), dtype=np.int64)
        if foreground is not None:
            index[foreground.region.slices] = foreground.index
        return [index == number + 1 for number in range(len(scene.shafts))]

    def _instrument(self, pose: ShaftPose, mask: NDArray[np.bool_]) -> Instrument:
        """The annotation of one shaft whose visible mask is not empty."""
        shaft = self._settings.shaft
        depth = cylinder_depth(self._renderer.camera, pose, shaft.diameter_mm, shaft.length_mm)
        # Mesh and cylinder may differ by a pixel on the edge: what is visible is also there.
        amodal = np.isfinite(depth) | mask
        visible, whole = int(mask.sum()), int(amodal.sum())
        return Instrument(
            pose, mask, mask_box(mask), mask_box(amodal), visible / whole, visible, whole
        )

    def _facts(self, scene: Scene, index: int) -> dict[str, object]:
        background = scene.background
        return {
            "background": background.name,
            "source": self._sources[background],
            "seed": self._seed,
            "index": index,
            **scene.facts(),
        }


def read_background(path: Path, size_px: int) -> NDArray[np.uint8]:
    """A background (size, size, 3) uint8 RGB. Raises InputError naming the file."""
    rgb = read_rgb(path)
    if rgb.shape[:2] != (size_px, size_px):
        raise InputError(f"{path}: not {size_px} x {size_px} px; run the backgrounds stage again")
    return rgb
