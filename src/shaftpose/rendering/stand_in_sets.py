"""The sets that stand in for real endoscopic images: other tissue, light, lens and air."""

from dataclasses import replace
from pathlib import Path

from shaftpose.backgrounds.library import procedural_sources, write_library
from shaftpose.backgrounds.tissue import STAND_IN
from shaftpose.backgrounds.variations import VariationRanges
from shaftpose.core.background_index import read_library
from shaftpose.rendering.image_sets import CLEAR, OCCLUDED, by_path, images_per_shard, with_scene
from shaftpose.rendering.optics import middle_camera
from shaftpose.rendering.rendered_set import RenderedSet
from shaftpose.settings.schema import Distortion, RenderSettings, RunSize

# Number added to the project's seed, and share of occluded images.
SETS = {"train": (2_000_001, 0.3), "clear": (2_000_002, 0.0), "occluded": (2_000_003, 1.0)}
SOURCES_PER_SET = 20  # at most; no more than a set has images


def stand_in_sets(
    settings: RenderSettings, size: RunSize, seed: int, folder: Path
) -> dict[str, RenderedSet]:
    """The sets by name; they share no background. folder: for the backgrounds."""
    images = {"train": size.stand_in_images, "clear": size.test_set, "occluded": size.test_set}
    side_px = settings.camera.size_px
    return {
        name: RenderedSet(
            settings=with_occlusion(settings, hidden),
            backgrounds=_backgrounds(
                folder / "backgrounds" / name,
                side_px,
                seed + own_seed,
                sources=min(SOURCES_PER_SET, images[name]),
            ),
            seed=seed + own_seed,
            images=images[name],
            images_per_shard=images_per_shard(images[name], size),
        )
        for name, (own_seed, hidden) in SETS.items()
    }


def _backgrounds(folder: Path, side_px: int, seed: int, sources: int) -> dict[Path, str]:
    """Tissue with the stand-in's look: image file -> id of its source."""
    unaltered = VariationRanges((0.0, 0.0), (1.0, 1.0), (1.0, 1.0))
    tissues = procedural_sources(sources, seed, side_px, STAND_IN)
    write_library(tissues, folder, 1, unaltered, seed, side_px, sources)
    return by_path(read_library(folder))


def with_occlusion(settings: RenderSettings, hidden: float) -> RenderSettings:
    """The stand-in's settings; `hidden` is the share of images with occluders, 0 for a clear set.

    Lens distortion is fixed at the middle of its range: COCO files do not state a camera, so all
    images use the one for silhouettes.
    """
    changed = OCCLUDED | {"occluder_probability": hidden} if hidden else CLEAR
    middle = middle_camera(settings)
    lens = replace(settings.lens, distortion=Distortion((middle.k1,) * 2, (middle.k2,) * 2))
    return replace(with_scene(settings, changed), lens=lens)
