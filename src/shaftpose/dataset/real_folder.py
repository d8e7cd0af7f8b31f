"""A user's folder of real images: checked and copied."""

import shutil
from pathlib import Path

from shaftpose.core.errors import InputError
from shaftpose.core.files import new_file
from shaftpose.dataset.coco import check_masks, read_coco
from shaftpose.dataset.real_images import read_pixels

PARTS = ("train", "test")


def copy_real(source: Path, out: Path) -> None:
    """Copy images and COCO files. Raises InputError if one of them is damaged."""
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
