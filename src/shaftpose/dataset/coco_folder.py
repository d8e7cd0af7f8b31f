"""The folder of images without poses: the user's, checked and copied, or a rendered stand-in.

It holds `images/`, `train.json` and `test.json`. The test images have masks.
"""

import shutil
from collections.abc import Iterator
from pathlib import Path

from shaftpose.core.errors import InputError
from shaftpose.core.files import new_file
from shaftpose.core.geometry import projected_axes
from shaftpose.core.images import write_jpeg
from shaftpose.core.shards import ShardedDataset
from shaftpose.dataset.coco import check_masks, read_coco, write_coco
from shaftpose.dataset.coco_images import SquareImage, read_pixels

PARTS = ("train", "test")


def copy_folder(source: Path, out: Path) -> None:
    """Copy the images and COCO files of `source` to `out`.

    Raises InputError if one of them is damaged, a test image lacks a mask, or an image is in both
    parts.
    """
    train, test = [read_coco(source / f"{part}.json") for part in PARTS]
    check_masks(test, source / "test.json")
    shared = {image.path for image in train} & {image.path for image in test}
    if shared:
        raise InputError(
            f"{source}: {min(shared).name} is in train.json and in test.json; "
            "keep it in one of them"
        )
    for image in train + test:
        read_pixels(image)
        with new_file(out / image.path.relative_to(source)) as target:
            shutil.copyfile(image.path, target)
    for part in PARTS:
        with new_file(out / f"{part}.json") as target:
            shutil.copyfile(source / f"{part}.json", target)


def write_stand_in(rendered: Path, out: Path) -> None:
    """Write rendered images to `out` as a stand-in for real ones.

    rendered: folder of the sets `train`, `clear` and `occluded`; the last two are the test images.
    """
    samples = {name: list(_squares(rendered / name)) for name in ("train", "clear", "occluded")}
    for name, square in [pair for pairs in samples.values() for pair in pairs]:
        write_jpeg(square.rgb, out / name)
    about = "stand-in for real endoscopic images, rendered; no poses"
    write_coco(out / "train.json", samples["train"], with_masks=False, description=about)
    test = samples["clear"] + samples["occluded"]
    write_coco(out / "test.json", test, with_masks=True, description=about)


def _squares(folder: Path) -> Iterator[tuple[str, SquareImage]]:
    """The images of a rendered set, with file names that begin with the set's name."""
    shards = ShardedDataset(folder)
    for key in shards.keys:
        known = shards.annotations(key)
        assert known.poses is not None
        square = SquareImage(
            rgb=shards.rgb(key),
            boxes=known.boxes,
            masks=tuple(shards.masks(key)),
            axes=projected_axes(known.poses, shards.camera(key)),
            occluded=bool(shards.scene_description(key)["occluders"]),
        )
        yield f"images/{folder.name}-{key}.jpg", square
