"""The sets of images on which silhouettes are compared: rendered and real, clear and occluded."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from shaftpose.dataset.coco import load_square, read_coco
from shaftpose.geometry import Camera
from shaftpose.images import Image
from shaftpose.instruments import Annotations
from shaftpose.shards import ShardedDataset

OCCLUSIONS = ("clear", "occluded")


@dataclass(frozen=True)
class MaskedImage:
    """One image with boxes and visible masks, wherever it comes from."""

    rgb: Image
    known: Annotations
    masks: Sequence[NDArray[np.bool_]]
    camera: Camera


def silhouette_sets(camera: Camera, domain: str) -> dict[str, list[MaskedImage]]:
    """Images by set: `rendered/clear`, `rendered/occluded` and the same of `domain`, the label of
    the real images or their stand-ins, which were taken by `camera`. Sets without images are left
    out."""
    sets = {f"rendered/{name}": _rendered(name) for name in OCCLUSIONS}
    sets |= {f"{domain}/{name}": images for name, images in _real(camera).items()}
    return {name: images for name, images in sets.items() if images}


def _rendered(name: str) -> list[MaskedImage]:
    shards = ShardedDataset(Path("data/render") / name)
    return [
        MaskedImage(shards.rgb(key), shards.annotations(key), shards.masks(key), shards.camera(key))
        for key in shards.keys
    ]


def _real(camera: Camera) -> dict[str, list[MaskedImage]]:
    """Those with an instrument in their central square, by occlusion."""
    sets: dict[str, list[MaskedImage]] = {name: [] for name in OCCLUSIONS}
    for image in tqdm(read_coco(Path("data/real/test.json")), "reading images", unit="image"):
        sample = load_square(image, camera.width)
        if len(sample.boxes):
            name = OCCLUSIONS[int(sample.occluded)]
            known = Annotations(sample.boxes, None)
            sets[name].append(MaskedImage(sample.rgb, known, sample.masks, camera))
    return sets
