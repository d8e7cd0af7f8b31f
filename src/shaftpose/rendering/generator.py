"""Image k of a dataset: its scene rendered, composited and annotated."""

from collections.abc import Mapping, Sequence
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.cylinder import cylinder_depth
from shaftpose.core.errors import InputError
from shaftpose.core.images import read_written
from shaftpose.core.masks import crossed_share, is_crossed
from shaftpose.core.samples import Instrument, Sample, sample_key
from shaftpose.rendering.blender import Foreground, Renderer
from shaftpose.rendering.compositing import composite, contact_shadow, darken
from shaftpose.rendering.optics import apply_lens
from shaftpose.rendering.placed_bodies import TOOL_INDEX
from shaftpose.rendering.scene import Scene
from shaftpose.rendering.scene_sampler import SceneSampler
from shaftpose.rendering.shapes import instrument_shape
from shaftpose.rendering.surroundings import lamp_places
from shaftpose.settings.schema import RenderSettings

_MOST_DRAWS = 250


class SampleGenerator:
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
        return Sample(
            key=sample_key(index),
            rgb=photograph(scene, foreground, self._settings),
            instruments=instruments,
            camera=scene.camera,
            scene_description=self._description(scene, index),
            tool_mask=_index(scene, foreground) == TOOL_INDEX,
        )

    def _acceptable(self, index: int) -> tuple[Scene, Foreground | None, tuple[Instrument, ...]]:
        """The first acceptable draw, rendered and annotated.

        Without occluders it is mostly the first one of all, because the sampler has checked
        visibility on a coarse grid.
        """
        for scene in islice(self._sampler.candidates(index), _MOST_DRAWS):
            foreground = self._renderer.render(scene)
            instruments = self._annotations(scene, foreground)
            if instruments is not None:
                return scene, foreground, instruments
        settings = self._settings.scene
        (low, high), (fewest, most) = settings.occluder_coverage, settings.crossing_coverage
        raise InputError(
            f"image {index}: all {_MOST_DRAWS} draws were rejected: a shaft shows fewer than "
            f"scene.min_visible_px = {settings.min_visible_px} px, its occluder is outside "
            f"scene.occluder_coverage = [{low:g}, {high:g}], or a crossing shaft hides nothing or "
            f"is outside scene.crossing_coverage = [{fewest:g}, {most:g}]; in params.yaml widen "
            "`poses` or these ranges (for occluded test sets: OCCLUDED in "
            "shaftpose/rendering/image_sets.py)"
        )

    def _annotations(
        self, scene: Scene, foreground: Foreground | None
    ) -> tuple[Instrument, ...] | None:
        """The annotated shafts; None if too little of one is visible, or if an occluder or a
        crossing shaft does not hide the required share."""
        settings, masks = self._settings.scene, _masks(scene, foreground)
        if any(mask.sum() < settings.min_visible_px for mask in masks):
            return None
        found = tuple(self._instrument(scene, n, mask) for n, mask in enumerate(masks))
        low, high = settings.occluder_coverage
        # Occluders are in front of the first shafts, one each.
        hidden = [1 - i.visible_fraction for i in found[: len(scene.occluders)]]
        crossed = crossed_shares(found, scene.crossing)
        if not all(low <= share <= high for share in hidden):
            return None
        return found if all(is_crossed(s, settings.crossing_coverage) for s in crossed) else None

    def _instrument(self, scene: Scene, number: int, mask: NDArray[np.bool_]) -> Instrument:
        """The annotation of one shaft whose visible mask is not empty."""
        # The edges of mesh and cylinder may differ by a pixel; amodal includes visible.
        amodal = self._whole(scene, number) | mask
        return Instrument(scene.shafts[number], mask, amodal, scene.rolls_deg[number])

    def _whole(self, scene: Scene, number: int) -> NDArray[np.bool_]:
        """Amodal mask (H, W) of a shaft: by geometry, or rendered alone."""
        pose, shape = scene.shafts[number], instrument_shape(self._settings.shaft)
        if shape.is_rod:
            return np.isfinite(
                cylinder_depth(scene.camera, pose, shape.diameter_mm, shape.length_mm)
            )
        rolls = (scene.rolls_deg[number],)
        return self._renderer.silhouettes([pose], scene.camera, rolls) == 1

    def _description(self, scene: Scene, index: int) -> dict[str, object]:
        background = scene.background
        return {
            "background": background.name,
            "source": self._sources[background],
            "seed": self._seed,
            "index": index,
            **scene.description(),
        }


def crossed_shares(instruments: Sequence[Instrument], crossing: int) -> list[float]:
    """The largest share that each of the last `crossing` instruments hides of another one.

    Exact: the sampler estimates it from plain rods on a coarse grid.
    """
    first = len(instruments) - crossing
    others = [other.amodal_mask for other in instruments[:first]]
    return [crossed_share(last.mask, others) for last in instruments[first:]]


def photograph(
    scene: Scene, foreground: Foreground | None, settings: RenderSettings
) -> NDArray[np.uint8]:
    """The image (H, W, 3) of a scene: its rendered foreground over its background, with the contact
    shadow, seen through the lens. Raises InputError naming the background if it cannot be used."""
    rgb = read_background(scene.background, settings.camera.size_px)
    if foreground is not None:
        if scene.contact_shadow:
            shafts = list(zip(scene.shafts, _masks(scene, foreground), strict=True))
            shadow = contact_shadow(scene.camera, shafts, lamp_places(settings.scene))
            rgb = darken(rgb, scene.contact_shadow * shadow)
        where = foreground.region.slices
        rgb[where] = composite(foreground.linear, rgb[where])
    camera = scene.camera
    shown = None if camera.field is None else np.isfinite(camera.rays()[..., 0])
    return apply_lens(rgb, scene.lens, scene.sensor_seed, shown)


def _masks(scene: Scene, foreground: Foreground | None) -> list[NDArray[np.bool_]]:
    """The visible pixels (H, W) of each shaft."""
    index = _index(scene, foreground)
    return [index == number + 1 for number in range(len(scene.shafts))]


def _index(scene: Scene, foreground: Foreground | None) -> NDArray[np.int64]:
    """The index (H, W) of the body in front at each pixel's centre: see `Foreground`."""
    index = np.zeros((scene.camera.height, scene.camera.width), dtype=np.int64)
    if foreground is not None:
        index[foreground.region.slices] = foreground.index
    return index


def read_background(path: Path, size_px: int) -> NDArray[np.uint8]:
    """A background (size, size, 3) uint8 RGB. Raises InputError naming the file."""
    rgb = read_written(path)
    if rgb.shape[:2] != (size_px, size_px):
        raise InputError(f"{path}: not {size_px} x {size_px} px; run `dvc repro backgrounds`")
    return rgb
