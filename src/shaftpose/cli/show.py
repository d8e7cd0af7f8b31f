"""`shaftpose show`: contact sheets of datasets and backgrounds."""

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from shaftpose.core.background_index import read_library
from shaftpose.core.errors import InputError, printable
from shaftpose.core.files import naming_refusal
from shaftpose.core.images import Image, write_jpeg
from shaftpose.core.shards import ShardedDataset
from shaftpose.figures.drawing import contact_sheet, draw_real, draw_sample, evenly_spaced
from shaftpose.image_files.reading import read_rgb

if TYPE_CHECKING:
    from shaftpose.dataset.coco_images import CocoImage

_MOST, _MOST_PX = 500, 600  # images, and the side of a real one


def run(options: argparse.Namespace) -> None:
    """Write a contact sheet of evenly spread images of a dataset or of backgrounds.

    Raises InputError if `--out` is no name for a JPEG file, or is a folder or a device, or
    `--count` is too large.
    """
    out = options.out
    if out.suffix.lower() not in (".jpg", ".jpeg") or (out.exists() and not out.is_file()):
        raise InputError(f"--out {out}: name a file that ends in .jpg")
    if options.count > _MOST:
        raise InputError(f"--count {options.count}: draw at most {_MOST} images at once")
    if options.what == "backgrounds":
        library = read_library(options.folder)
        chosen = [read_rgb(background.path) for background in evenly_spaced(library, options.count)]
    elif real := real_images(options.folder):
        chosen = draw_squares(evenly_spaced(real, options.count))
    else:
        shards = ShardedDataset(options.folder)
        chosen = [draw_sample(shards, key) for key in evenly_spaced(shards.keys, options.count)]
    with naming_refusal(out, "name another file by --out"):
        write_jpeg(contact_sheet(chosen, min(options.columns, len(chosen))), out, quality=85)
    print(f"{len(chosen)} images are drawn in {printable(str(out))}")


def real_images(folder: Path) -> list["CocoImage"]:
    """The images in the COCO files of a folder; none without such files."""
    parts = ("train.json", "validation.json", "test.json")
    files = [file for name in parts if (file := folder / name).is_file()]
    if not files:  # rendered images need no packages of the extra
        return []
    with _needing("train"):
        from shaftpose.dataset.coco import read_coco
    return [image for file in files for image in read_coco(file)]


def draw_squares(images: Sequence["CocoImage"]) -> list[Image]:
    """Central squares, all of the smallest one's size but not larger than needed, with boxes and,
    where known, masks."""
    from shaftpose.dataset.coco_images import load_square  # `real_images` has checked its packages

    side_px = min(_MOST_PX, *(min(image.width, image.height) for image in images))
    squares = [load_square(image, side_px) for image in images]
    return [draw_real(square.rgb, square.masks, square.boxes) for square in squares]


@contextmanager
def _needing(extra: str) -> Iterator[None]:
    """Guard an import of packages from an extra. Such imports stand inside functions, because
    prediction must run without them. Raises InputError naming the extra if a package is missing."""
    try:
        yield
    except ModuleNotFoundError as error:
        raise InputError(
            f"this needs {error.name}, which is not installed; "
            f"in a clone, run pip install '.[{extra}]'"
        ) from error
