"""Image sets for the comparison of silhouettes: rendered and real, clear and occluded."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from shaftpose.core.geometry import Camera, projected_axes
from shaftpose.core.images import Image
from shaftpose.core.instruments import Annotations
from shaftpose.core.shards import ShardedDataset
from shaftpose.dataset.coco import read_coco
from shaftpose.dataset.coco_images import load_square

OCCLUSIONS = ("clear", "occluded")


@dataclass(frozen=True)
class MaskedImage:
    """One rendered or real image with boxes, visible masks and axes (G, 2, 2) px in the image.

    left_out: (S, S), pixels of shafts that the annotations lack; None if there are none.
    """

    rgb: Image
    known: Annotations
    masks: Sequence[NDArray[np.bool_]]
    axes: NDArray[np.float64]
    camera: Camera
    left_out: NDArray[np.bool_] | None = None


def silhouette_sets(camera: Camera, domain: str) -> dict[str, list[MaskedImage]]:
    """Images by set: `rendered/clear`, `rendered/occluded`, and both for `domain`.

    domain: label of the real images or stand-ins; camera: their camera. Empty sets are left out.
    """
    sets = {f"rendered/{name}": _rendered(name) for name in OCCLUSIONS}
    sets |= {f"{domain}/{name}": images for name, images in _real(camera).items()}
    return {name: images for name, images in sets.items() if images}


def _rendered(name: str) -> list[MaskedImage]:
    shards = ShardedDataset(Path("data/render") / name)
    images = []
    for key in shards.keys:
        known, camera = shards.annotations(key), shards.camera(key)
        assert known.poses is not None
        axes = projected_axes(known.poses, camera)
        images.append(MaskedImage(shards.rgb(key), known, shards.masks(key), axes, camera))
    return images


def _real(camera: Camera) -> dict[str, list[MaskedImage]]:
    """Images with an instrument in their central square, by occlusion."""
    sets: dict[str, list[MaskedImage]] = {name: [] for name in OCCLUSIONS}
    for image in tqdm(read_coco(Path("data/real/test.json")), "reading images", unit="image"):
        sample = load_square(image, camera.width)
        if len(sample.boxes):
            name = OCCLUSIONS[int(sample.occluded)]
            known = Annotations(sample.boxes, None)
            sets[name].append(
                MaskedImage(sample.rgb, known, sample.masks, sample.axes, camera, sample.left_out)
            )
    return sets
