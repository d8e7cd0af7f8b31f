"""Test images with masks: rendered ones and ones without poses, clear and occluded."""

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
from shaftpose.evaluation.results import OCCLUSIONS


@dataclass(frozen=True)
class MaskedImage:
    """One image with the visible mask of each instrument.

    axes: (G, 2, 2) px, tip and another point of each axis; left_out: (S, S), pixels of shafts that
    the annotations lack, None if there are none.
    """

    rgb: Image
    known: Annotations
    masks: Sequence[NDArray[np.bool_]]
    axes: NDArray[np.float64]
    camera: Camera
    left_out: NDArray[np.bool_] | None = None


def masked_images(
    rendered: Path, unposed: Path, domain: str, camera: Camera
) -> dict[str, list[MaskedImage]]:
    """Images by set: `rendered/clear`, `rendered/occluded`, and both for `domain`.

    rendered: folder of the rendered sets; unposed: folder of the images without poses; domain:
    their label; camera: their camera. Empty sets are left out.
    """
    sets = {f"rendered/{name}": _rendered(rendered / name) for name in OCCLUSIONS}
    without_poses = _unposed(unposed / "test.json", camera)
    sets |= {f"{domain}/{name}": images for name, images in without_poses.items()}
    return {name: images for name, images in sets.items() if images}


def _rendered(folder: Path) -> list[MaskedImage]:
    shards = ShardedDataset(folder)
    images = []
    for key in shards.keys:
        known, camera = shards.annotations(key), shards.camera(key)
        assert known.poses is not None
        axes = projected_axes(known.poses, camera)
        images.append(MaskedImage(shards.rgb(key), known, shards.masks(key), axes, camera))
    return images


def _unposed(annotations: Path, camera: Camera) -> dict[str, list[MaskedImage]]:
    """Images of a COCO file with an instrument in their central square, by occlusion."""
    sets: dict[str, list[MaskedImage]] = {name: [] for name in OCCLUSIONS}
    for image in tqdm(read_coco(annotations), "reading images", unit="image", disable=None):
        square = load_square(image, camera.width)
        if len(square.boxes):
            name = OCCLUSIONS[int(square.occluded)]
            known = Annotations(square.boxes, None)
            sets[name].append(
                MaskedImage(square.rgb, known, square.masks, square.axes, camera, square.left_out)
            )
    return sets
