"""Real images: a folder with `images/` and COCO annotations that have boxes but no poses."""

import json
import logging
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePath
from typing import Annotated, Any

import cv2
import numpy as np
import pydantic
from numpy.typing import NDArray
from pydantic import AfterValidator, AliasPath, ConfigDict, Field

from shaftpose.config import PositiveInt, parse
from shaftpose.errors import InputError
from shaftpose.files import new_file
from shaftpose.images import Image, centre_square, read_rgb
from shaftpose.shards import decode_mask

log = logging.getLogger(__name__)

# OpenCV fills in sixteenths of a pixel around centres and adds the outline. On a grid three times
# as fine, whose every third point is a pixel's centre, the outline does not reach the next one.
_SUBPIXEL_BITS = 4
_FINER = 3

_ROUNDING_PX = 1.0  # by which a box may leave its image: annotation tools round its numbers


@dataclass(frozen=True)
class RealInstrument:
    """One annotated shaft; box x0, y0, x1, y1 and polygons (N, 2) in pixels of the image file.

    polygons is empty where only boxes are known.
    """

    box: tuple[float, float, float, float]
    polygons: tuple[NDArray[np.float64], ...]
    occluded: bool


@dataclass(frozen=True)
class RealImage:
    """One image file and its instruments."""

    path: Path
    width: int
    height: int
    instruments: tuple[RealInstrument, ...]


@dataclass(frozen=True)
class RealSample:
    """A real image as the network sees it: rgb (S, S, 3), boxes (G, 4) px, masks G x (S, S)."""

    rgb: NDArray[np.uint8]
    boxes: NDArray[np.float64]
    masks: tuple[NDArray[np.bool_], ...]
    occluded: bool


def _inside_folder(name: str) -> str:
    if PurePath(name).is_absolute() or ".." in PurePath(name).parts:
        raise ValueError("must lie in the annotation file's folder; move the image there")
    return name


_Number = Annotated[float, Field(strict=True)]
_FINITE = ConfigDict(allow_inf_nan=False)


@pydantic.dataclasses.dataclass(frozen=True)
class _ImageEntry:
    """What is read of one of COCO's `images`."""

    id: int
    file_name: Annotated[str, AfterValidator(_inside_folder)]
    width: PositiveInt
    height: PositiveInt


@pydantic.dataclasses.dataclass(frozen=True, config=_FINITE)
class _Annotation:
    """What is read of one of COCO's `annotations`."""

    image_id: int
    bbox: Annotated[list[_Number], Field(min_length=4, max_length=4)]  # x, y, width, height
    segmentation: Any = ()  # `_polygons` checks it
    iscrowd: bool = False
    occluded: Annotated[bool, Field(validation_alias=AliasPath("attributes", "occluded"))] = False


def read_coco(path: Path) -> list[RealImage]:
    """The images of a COCO file, ordered by file name; names are relative to the file's folder.

    Every annotation is a shaft, whatever its category, but for crowds (`iscrowd`: 1), which are
    several shafts in one box: they are left out, and a warning counts them.
    Raises InputError naming the file and the entry for a missing or damaged annotation file, one
    without images, entries that lack a value or hold a wrong one, an image that is listed twice or
    not there, and a box that leaves its image by more than a pixel.
    """
    content = _read_json(path)
    entries = _image_entries(content["images"], path)
    instruments: dict[int, list[RealInstrument]] = {number: [] for number in entries}
    crowds = 0
    for n, values in enumerate(content["annotations"]):
        where = f"{path}: annotations[{n}]"
        annotation = parse(_Annotation, values, where)
        if annotation.image_id not in entries:
            raise InputError(
                f"{where}.image_id = {annotation.image_id}: no image has this id; "
                "list the image or remove the annotation"
            )
        if annotation.iscrowd:
            crowds += 1
        else:
            entry = entries[annotation.image_id]
            instruments[entry.id].append(_instrument(annotation, entry, where))
    if crowds:
        log.warning("%s: left out %d annotations of crowds; box each shaft of them", path, crowds)
    found = [_image(entry, instruments[number], path) for number, entry in entries.items()]
    return sorted(found, key=lambda image: image.path.name)


def _read_json(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_bytes())
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({error.strerror}); put a COCO file there"
        ) from error
    except ValueError as error:
        raise InputError(f"{path}: no JSON ({error}); mend or replace it") from error
    for name in ("images", "annotations"):
        if not isinstance(content, dict) or not isinstance(content.get(name), list):
            raise InputError(f"{path}: lacks the list `{name}`; it must be a COCO file")
    return content


def _image_entries(images: list[Any], path: Path) -> dict[int, _ImageEntry]:
    if not images:
        raise InputError(f"{path}: lists no image; add one or more to `images`")
    entries: dict[int, _ImageEntry] = {}
    names: set[PurePath] = set()
    for n, values in enumerate(images):
        where = f"{path}: images[{n}]"
        entry = parse(_ImageEntry, values, where)
        if entry.id in entries:
            raise InputError(f"{where}.id = {entry.id}: another image has this id; change one")
        if PurePath(entry.file_name) in names:
            raise InputError(
                f"{where}.file_name = {entry.file_name!r}: listed twice; remove one entry and "
                "give its annotations to the other"
            )
        entries[entry.id] = entry
        names.add(PurePath(entry.file_name))
    return entries


def _image(entry: _ImageEntry, instruments: list[RealInstrument], path: Path) -> RealImage:
    file = path.parent / entry.file_name
    if not os.path.isfile(file):  # False, unlike Path's method, where a folder may not be entered
        raise InputError(
            f"{path}: names {file}, but there is no such file; add it or remove its entry"
        )
    return RealImage(file, entry.width, entry.height, tuple(instruments))


def _instrument(annotation: _Annotation, entry: _ImageEntry, where: str) -> RealInstrument:
    x, y, width, height = annotation.bbox
    corners = np.array([[x, y], [x + width, y + height]])
    clipped = np.clip(corners, 0, [entry.width, entry.height])
    if np.any(clipped[0] >= clipped[1]) or np.abs(corners - clipped).max() > _ROUNDING_PX:
        raise InputError(
            f"{where}: the box {annotation.bbox} of {entry.file_name} is empty or leaves the "
            f"image of {entry.width} x {entry.height}; mend the box"
        )
    (x0, y0), (x1, y1) = clipped.tolist()
    polygons = _polygons(annotation.segmentation, entry, f"{where}.segmentation")
    return RealInstrument((x0, y0, x1, y1), polygons, annotation.occluded)


def _polygons(segmentation: Any, entry: _ImageEntry, where: str) -> tuple[NDArray[np.float64], ...]:
    """COCO's polygons, or run lengths turned into polygons, as arrays (N, 2)."""
    if isinstance(segmentation, dict):
        segmentation = mask_polygons(_run_length_mask(segmentation, entry, where))
    if not isinstance(segmentation, list | tuple):
        raise InputError(f"{where} = {segmentation!r}: must be a list of polygons")
    return tuple(_polygon(points, f"{where}[{n}]") for n, points in enumerate(segmentation))


def _polygon(points: Any, where: str) -> NDArray[np.float64]:
    try:
        values = np.array(points, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"{where}: holds more than numbers; a polygon is x, y, x, y, ..."
        ) from error
    if values.ndim != 1 or values.size % 2 or values.size < 6 or not np.isfinite(values).all():
        raise InputError(
            f"{where}: must hold x and y of three points or more, x, y, x, y, ...; mend the polygon"
        )
    return values.reshape(-1, 2)


def _run_length_mask(encoded: dict[str, Any], entry: _ImageEntry, where: str) -> NDArray[np.bool_]:
    counts, size = encoded.get("counts"), [entry.height, entry.width]
    if isinstance(counts, str):
        raise InputError(
            f"{where}: compressed run lengths are not read; write polygons, or counts as a list"
        )
    if encoded.get("size") != size or not _fill(counts, entry.height * entry.width):
        raise InputError(
            f"{where}: run lengths need the size {size} of {entry.file_name} (height, width) and "
            "counts that add up to its pixels; mend them or write polygons"
        )
    return decode_mask(encoded)


def _fill(counts: Any, pixels: int) -> bool:
    """Whether counts are run lengths of so many pixels."""
    numbers = isinstance(counts, list) and all(isinstance(n, int) and n >= 0 for n in counts)
    return numbers and sum(counts) == pixels


def check_masks(images: Sequence[RealImage], path: Path) -> None:
    """Raise InputError naming the first shaft of a COCO file that has a box but no polygons."""
    for image in images:
        for instrument in image.instruments:
            if not instrument.polygons:
                raise InputError(
                    f"{path}: the shaft of {image.path.name} in the box {instrument.box} "
                    "(x0, y0, x1, y1) has no `segmentation`, which tests need; add its polygons"
                )


def read_pixels(image: RealImage) -> Image:
    """The image itself (H, W, 3). Raises InputError naming it if it is damaged or of another size
    than stated."""
    rgb = read_rgb(image.path)
    if rgb.shape[:2] != (image.height, image.width):
        raise InputError(
            f"{image.path}: has {rgb.shape[1]} x {rgb.shape[0]} px, its COCO entry says "
            f"{image.width} x {image.height}; mend the entry"
        )
    return rgb


def load_square(image: RealImage, size_px: int) -> RealSample:
    """The central square of a real image, resized, with what remains of its annotations.

    An instrument of whose box less than a fifth lies in the square is dropped.
    """
    rgb = read_pixels(image)
    side = min(image.width, image.height)
    left, top = (image.width - side) // 2, (image.height - side) // 2
    scale = size_px / side
    moved = [_moved(i, np.array([left, top]), scale, size_px) for i in image.instruments]
    kept = [instrument for instrument in moved if instrument is not None]
    return RealSample(
        rgb=centre_square(rgb, size_px),
        boxes=np.array([i.box for i in kept], dtype=np.float64).reshape(-1, 4),
        masks=tuple(polygon_mask(i.polygons, size_px) for i in kept),
        occluded=any(instrument.occluded for instrument in kept),
    )


def _moved(
    instrument: RealInstrument, origin: NDArray[np.float64], scale: float, size_px: int
) -> RealInstrument | None:
    corners = np.array(instrument.box).reshape(2, 2)
    whole = (corners - origin) * scale
    box = np.clip(whole, 0, size_px)
    if np.prod(box[1] - box[0]) < 0.2 * np.prod(whole[1] - whole[0]):
        return None
    (x0, y0), (x1, y1) = box.tolist()
    polygons = tuple((points - origin) * scale for points in instrument.polygons)
    return replace(instrument, box=(x0, y0, x1, y1), polygons=polygons)


def polygon_mask(polygons: tuple[NDArray[np.float64], ...], size_px: int) -> NDArray[np.bool_]:
    """(size, size) union of polygons whose coordinates count from the image's upper left corner."""
    mask = np.zeros((_FINER * size_px, _FINER * size_px), dtype=np.uint8)
    scale = 1 << _SUBPIXEL_BITS
    for polygon in polygons:  # one by one: filled together, they would cut holes where they overlap
        points = np.rint((polygon * _FINER - 0.5) * scale).astype(np.int32)
        cv2.fillPoly(mask, [points], (1,), shift=_SUBPIXEL_BITS)
    return mask[_FINER // 2 :: _FINER, _FINER // 2 :: _FINER].astype(bool)


def mask_polygons(mask: NDArray[np.bool_]) -> list[list[float]]:
    """COCO polygons through the centres of a mask's border pixels; `polygon_mask` inverts it."""
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    polygons = [(contour.reshape(-1, 2) + 0.5).ravel().tolist() for contour in contours]
    return [polygon for polygon in polygons if len(polygon) >= 6]


def write_coco(
    path: Path, images: Sequence[tuple[str, RealSample]], with_masks: bool, description: str
) -> None:
    """Write samples, given with their file names, as a COCO file; polygons only if asked for."""
    content: dict[str, Any] = {
        "info": {"description": description},
        "images": [],
        "annotations": [],
        "categories": [{"id": 1, "name": "shaft"}],
    }
    for number, (name, sample) in enumerate(images, start=1):
        height, width = sample.rgb.shape[:2]
        content["images"].append(
            {"id": number, "file_name": name, "width": width, "height": height}
        )
        for box, mask in zip(sample.boxes.tolist(), sample.masks, strict=True):
            content["annotations"].append(
                {
                    "id": len(content["annotations"]) + 1,
                    "image_id": number,
                    "category_id": 1,
                    "iscrowd": 0,
                    "bbox": [box[0], box[1], box[2] - box[0], box[3] - box[1]],
                    "area": int(mask.sum()),
                    "segmentation": mask_polygons(mask) if with_masks else [],
                    "attributes": {"occluded": sample.occluded},
                }
            )
    with new_file(path) as part:
        part.write_text(json.dumps(content, indent=1) + "\n")
