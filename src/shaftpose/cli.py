"""The command line: `shaftpose predict` and `shaftpose show`."""

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, get_args

import numpy as np

from shaftpose.core.background_index import read_library
from shaftpose.core.drawing import (
    contact_sheet,
    draw_detections,
    draw_real,
    draw_sample,
    evenly_spaced,
)
from shaftpose.core.geometry import Camera
from shaftpose.core.images import Image, centre_square, read_rgb, write_jpeg
from shaftpose.core.instruments import POSE_DIMENSIONS, Detections
from shaftpose.core.shards import ShardedDataset
from shaftpose.deployment.bundled import bundled_model
from shaftpose.deployment.predictor import Predictor
from shaftpose.errors import InputError
from shaftpose.refinement.refiner import Refinement

if TYPE_CHECKING:
    from shaftpose.dataset.coco import RealImage


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command; an InputError ends it with one line and status 1."""
    options = _parser().parse_args(arguments)
    try:
        options.run(options)
    except InputError as error:
        sys.exit(f"error: {error}")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("shaftpose", description=__doc__)
    commands = parser.add_subparsers(required=True)
    _add_predict(commands.add_parser("predict", help="find shafts and their poses in images"))
    _add_show(commands.add_parser("show", help="draw a contact sheet of a folder"))
    return parser


def _add_predict(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("images", nargs="+", type=Path, help="PNG or JPEG files")
    parser.add_argument("--model", type=Path, help="ONNX file (the package's own model)")
    parser.add_argument("--confidence", type=float, help="least score (the model's own)")
    parser.add_argument(
        "--refine", choices=get_args(Refinement), default="edges",
        help="what poses are fitted to, if the model has a mask (edges: the mask, then the edges)",
    )  # fmt: skip
    parser.add_argument("--draw", type=Path, help="folder for images with what was found")
    parser.add_argument("--view-deg", type=float, help="view angle, for --draw (the model's own)")
    parser.set_defaults(run=predict)


def _add_show(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("what", choices=("dataset", "backgrounds"))
    parser.add_argument("folder", type=Path, help="of shards, real images or backgrounds")
    parser.add_argument("--out", type=Path, required=True, help="the JPEG file to write")
    parser.add_argument("--count", type=positive, default=20, help="number of images (20)")
    parser.add_argument("--columns", type=positive, default=5, help="images in a row (5)")
    parser.set_defaults(run=show)


def positive(text: str) -> int:
    """A whole number above 0, for argparse."""
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"{number} is not above 0")
    return number


def predict(options: argparse.Namespace) -> None:
    """Print a line of JSON for each image: boxes in pixels of its central square at the model's
    size, poses in mm and deg."""
    predictor = Predictor(
        bundled_model() if options.model is None else options.model, options.refine
    )
    side_px = predictor.side_px
    view_deg = predictor.facts.view_deg if options.view_deg is None else options.view_deg
    camera = Camera.from_field_of_view(side_px, side_px, view_deg)
    least = predictor.confidence if options.confidence is None else options.confidence
    targets = _drawings(options.images, options.draw) if options.draw else {}
    for path in options.images:
        image = centre_square(read_rgb(path), side_px)
        found = predictor(image[None])[0].above(least)
        print(json.dumps({"image": str(path), "instruments": as_rows(found)}))
        if options.draw:
            write_jpeg(draw_detections(image, found, camera), targets[path])


def _drawings(images: Sequence[Path], folder: Path) -> dict[Path, Path]:
    """Image -> file of its drawing. Raises InputError if two would share one, or an image would be
    overwritten."""
    targets = {path: folder / f"{path.stem}.jpg" for path in images}
    taken = {path.resolve() for path in images}
    for path, target in targets.items():
        if target.resolve() in taken:
            raise InputError(
                f"--draw {folder}: {target}, for {path}, is taken by another image; draw into "
                "another folder, images of the same name into different ones"
            )
        taken.add(target.resolve())
    return targets


def as_rows(found: Detections) -> list[dict[str, object]]:
    """Detections as plain values."""
    return [
        {
            "score": round(float(score), 4),
            "box": np.round(box, 1).tolist(),
            **{name: round(float(v), 2) for name, v in zip(POSE_DIMENSIONS, pose, strict=True)},
        }
        for box, score, pose in zip(found.boxes, found.scores, found.poses, strict=True)
    ]


def show(options: argparse.Namespace) -> None:
    """Write a contact sheet of evenly spread images of a dataset or of backgrounds."""
    if options.what == "backgrounds":
        library = read_library(options.folder)
        chosen = [read_rgb(background.path) for background in evenly_spaced(library, options.count)]
    elif real := real_images(options.folder):
        chosen = draw_squares(evenly_spaced(real, options.count))
    else:
        shards = ShardedDataset(options.folder)
        chosen = [draw_sample(shards, key) for key in evenly_spaced(shards.keys, options.count)]
    write_jpeg(contact_sheet(chosen, options.columns), options.out, quality=85)
    print(f"{len(chosen)} images are drawn in {options.out}")


def real_images(folder: Path) -> list["RealImage"]:
    """What the COCO files of a folder list; nothing if it has none."""
    files = [file for name in ("train.json", "test.json") if (file := folder / name).is_file()]
    if not files:  # rendered images are shown without what `read_coco` needs
        return []
    with _needing("train"):
        from shaftpose.dataset.coco import read_coco
    return [image for file in files for image in read_coco(file)]


def draw_squares(images: Sequence["RealImage"]) -> list[Image]:
    """Central squares, all of the smallest one's size, with boxes and, where known, masks."""
    from shaftpose.dataset.coco import load_square  # its packages are there: `real_images` read

    side_px = min(min(image.width, image.height) for image in images)
    squares = [load_square(image, side_px) for image in images]
    return [draw_real(square.rgb, square.masks, square.boxes) for square in squares]


@contextmanager
def _needing(extra: str) -> Iterator[None]:
    """Import what only an extra of the package brings, inside the function that uses it: prediction
    has to run without. Raises InputError naming the extra if a package is missing."""
    try:
        yield
    except ModuleNotFoundError as error:
        raise InputError(
            f"this needs {error.name}, which is not installed; "
            f"run: pip install 'shaftpose[{extra}]'"
        ) from error
