"""Rendering: one Blender scene per process, updated for each image, rendered by Cycles."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain

import bpy
import numpy as np
from numpy.typing import NDArray

from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.core.masks import mask_box
from shaftpose.rendering.cycles import PassReader, set_border, set_up_cycles, use_device
from shaftpose.rendering.materials import SceneImages
from shaftpose.rendering.optics import pinhole_behind, seen_by
from shaftpose.rendering.placed_bodies import Shafts, Unannotated
from shaftpose.rendering.regions import Region, cover, touched_pixels
from shaftpose.rendering.scene import Scene
from shaftpose.rendering.shapes import instrument_shape
from shaftpose.rendering.surroundings import Surroundings
from shaftpose.settings.schema import RenderSettings

# Fixed cost of a render, in samples of empty pixels: 0.5 ms in Cycles at 0.2 us per sample, plus a
# reserve for Python's overhead.
_RENDER_PX_SAMPLES = 4_000


@dataclass(frozen=True)
class Foreground:
    """Blender's output for the region of shafts and occluders; the whole image if distorted.

    linear: (h, w, 4) float32, scene-linear RGB premultiplied by alpha; index: (h, w) int, n + 1
    where shaft n is in front at the pixel's centre, `TOOL_INDEX` where jaws are, 0 elsewhere.
    """

    region: Region
    linear: NDArray[np.float32]
    index: NDArray[np.int64]


class Renderer:
    """Renders scenes. Only one may exist per process, because Blender has one open file.

    Raises InputError if the settings' CAD file or distortion cannot be used.
    """

    def __init__(self, settings: RenderSettings) -> None:
        self._pinhole = pinhole_behind(settings)
        bpy.ops.wm.read_factory_settings(use_empty=True)
        self._scene = bpy.context.scene
        set_up_cycles(self._scene, self._pinhole.width, settings.samples[1])
        use_device(self._scene, settings.device)
        self._surroundings = Surroundings(self._scene, settings, self._pinhole)
        self._shafts = Shafts(self._scene, instrument_shape(settings.shaft))
        self._unannotated = Unannotated(self._scene)
        self._images = SceneImages()
        self._reader = PassReader()

    def render(self, scene: Scene) -> Foreground | None:
        """Render the shafts and occluders of a scene; None if nothing is in view."""
        self._images.begin_scene()
        background = self._surroundings.show(scene.background, scene.light, self._images)
        self._shafts.place(scene.shafts, scene.rolls_deg)
        self._shafts.dress(scene, self._images)
        self._unannotated.clear()
        self._unannotated.add_jaws(scene.jaws, self._shafts.places)
        self._unannotated.add_lumps(scene.occluders, background)
        return self._render_for(scene.camera, scene.samples)

    def silhouettes(
        self, poses: Sequence[ShaftPose], camera: Camera, rolls_deg: Sequence[float] | None = None
    ) -> NDArray[np.int64]:
        """Index (H, W) of the shaft in front at each pixel's centre of `camera`, n + 1, or 0."""
        self._shafts.place(poses, rolls_deg or [0.0] * len(poses))
        self._unannotated.clear()
        index = np.zeros((camera.height, camera.width), dtype=np.int64)
        # The index is exact at one sample, unlike a colour.
        foreground = self._render_for(camera, samples=1)
        if foreground is not None:
            index[foreground.region.slices] = foreground.index
        return index

    def _render_for(self, camera: Camera, samples: int) -> Foreground | None:
        """Render the placed scene, as seen by `camera`."""
        foreground = self._render_regions(samples)
        if foreground is None or camera == self._pinhole:
            return foreground
        linear = np.zeros((self._pinhole.height, self._pinhole.width, 4), dtype=np.float32)
        index = np.zeros(linear.shape[:2], dtype=np.int64)
        linear[foreground.region.slices] = foreground.linear
        index[foreground.region.slices] = foreground.index
        whole = Region(0, 0, camera.width, camera.height)
        return Foreground(whole, *seen_by(camera, self._pinhole, linear, index))

    def _render_regions(self, samples: int) -> Foreground | None:
        """Call Blender for each non-empty part of the image."""
        bodies = chain(self._shafts.meshes(), self._unannotated.meshes())
        touched = touched_pixels(self._pinhole, bodies)
        if not touched.any():
            return None
        self._scene.cycles.sample_subset_length = samples
        linear = np.zeros((*touched.shape, 4), dtype=np.float32)
        index = np.zeros(touched.shape, dtype=np.int64)
        for region in cover(touched, _RENDER_PX_SAMPLES / samples):
            set_border(self._scene, region, self._pinhole)
            passes = self._reader.render()
            self._images.remove_past()
            linear[region.slices] = passes["Combined"]
            index[region.slices] = np.rint(passes["IndexOB"][..., 0])
        whole = Region(*mask_box(touched))
        return Foreground(whole, linear[whole.slices], index[whole.slices])
