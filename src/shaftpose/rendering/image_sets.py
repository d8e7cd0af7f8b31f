"""The image sets of the render stage."""

from dataclasses import replace
from math import ceil
from pathlib import Path
from typing import Any

from shaftpose.core.background_index import Background, hold_out
from shaftpose.rendering.rendered_set import RenderedSet
from shaftpose.settings.schema import RenderSettings, RunSize

# Scene settings of sets without occluders.
CLEAR: dict[str, Any] = {"occluder_probability": 0.0, "crossing_probability": 0.0}
# Scene settings of sets with hidden shafts: at least a fifth of each shaft is hidden, so that no
# image is clear by chance, and a fifth is visible. A crossing shaft would be in front of its
# occluder.
OCCLUDED: dict[str, Any] = {
    "occluder_probability": 1.0,
    "occluder_coverage": (0.2, 0.8),
    "crossing_probability": 0.0,
}
# Added to the project's seed, so that the sets share no image.
SET_SEEDS = {"images": 0, "clear": 1_000_001, "occluded": 1_000_002}


def with_scene(settings: RenderSettings, changed: dict[str, Any]) -> RenderSettings:
    """The settings with the `changed` scene settings."""
    return replace(settings, scene=replace(settings.scene, **changed))


def rendered_sets(
    settings: RenderSettings, size: RunSize, library: list[Background], held_out: float, seed: int
) -> dict[str, RenderedSet]:
    """The sets by name. The user's occluder probability applies to `images`; `clear` has neither
    occluders nor shafts added to cross others, `occluded` has an occluder in front of each shaft.

    held_out: share of the library's sources reserved for `clear` and `occluded`. Raises InputError
    if the library has too few sources.
    """
    kept, held = hold_out(library, held_out, seed)
    sets = {
        "images": (settings, kept, size.images),
        "clear": (with_scene(settings, CLEAR), held, size.test_set),
        "occluded": (with_scene(settings, OCCLUDED), held, size.test_set),
    }
    return {
        name: RenderedSet(
            settings=its_settings,
            backgrounds=by_path(backgrounds),
            seed=seed + SET_SEEDS[name],
            images=images,
            images_per_shard=images_per_shard(images, size),
        )
        for name, (its_settings, backgrounds, images) in sets.items()
    }


def images_per_shard(images: int, size: RunSize) -> int:
    """Images per shard of a set: the profile's number, at most half of the set."""
    # One process renders a shard: two shards let a small set use two cores. The number of cores is
    # ignored, because shards must not depend on the machine.
    return min(size.images_per_shard, ceil(images / 2))


def by_path(backgrounds: list[Background]) -> dict[Path, str]:
    """Background file -> id of its source."""
    return {background.path: background.source for background in backgrounds}
