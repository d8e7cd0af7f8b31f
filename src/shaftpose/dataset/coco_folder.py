"""The folder of images without poses: the user's, checked and copied, or a rendered stand-in.

It holds `images/`, `train.json`, `test.json` and perhaps `validation.json`. The shafts of the last
two have masks.
"""

import shutil
from collections.abc import Iterator, Sequence
from itertools import chain, combinations
from pathlib import Path

from shaftpose.core.errors import InputError
from shaftpose.core.files import new_file
from shaftpose.core.geometry import projected_axes
from shaftpose.core.images import write_jpeg
from shaftpose.core.shards import ShardedDataset
from shaftpose.dataset.coco import check_masks, read_coco, write_coco
from shaftpose.dataset.coco_images import CocoImage, SquareImage, read_pixels

PARTS = ("train", "validation", "test")


def copy_folder(source: Path, out: Path) -> None:
    """Copy the images and COCO files of `source` to `out`.

    Raises InputError if one of them is damaged, a shaft of a part that is measured lacks a mask, or
    an image is in two parts.
    """
    parts = read_folder(source)
    for part in parts.keys() - {"train"}:
        check_masks(parts[part], source / f"{part}.json")
    _check_apart(parts, source)
    for image in chain(*parts.values()):
        read_pixels(image)
        _copy(image.path, out / image.path.relative_to(source))
    for part in PARTS:  # those of another source, too
        (out / f"{part}.json").unlink(missing_ok=True)
    for part in parts:
        _copy(source / f"{part}.json", out / f"{part}.json")


def read_folder(folder: Path) -> dict[str, list[CocoImage]]:
    """The images of each part of a folder; `validation` only if its file exists."""
    files = {part: folder / f"{part}.json" for part in PARTS}
    return {
        part: read_coco(path)
        for part, path in files.items()
        if part != "validation" or path.exists()
    }


def summary(images: Sequence[CocoImage]) -> str:
    """The numbers of a file's images and annotations, in words."""
    shafts = [shaft for image in images for shaft in image.instruments]
    outlined = sum(shaft.mask is not None for shaft in shafts)
    tools = sum(len(image.tools) for image in images)
    return f"{len(images)} images with {len(shafts)} shafts ({outlined} outlined), {tools} tools"


def _check_apart(parts: dict[str, list[CocoImage]], source: Path) -> None:
    for one, other in combinations(parts, 2):
        shared = {image.path for image in parts[one]} & {image.path for image in parts[other]}
        if shared:
            raise InputError(
                f"{source}: {min(shared).name} is in {one}.json and in {other}.json; "
                "keep it in one of them"
            )


def _copy(source: Path, target: Path) -> None:
    with new_file(target) as path:
        shutil.copyfile(source, path)


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
