"""COCO files: images with boxes, and perhaps masks and tips, but without poses."""

import json
import logging
import os
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path, PurePath, PureWindowsPath
from typing import Annotated, Any

import cv2
import numpy as np
import pydantic
from pydantic import AliasPath, ConfigDict, Field

from shaftpose import MOST_PIXELS
from shaftpose.core.errors import InputError
from shaftpose.core.files import write_json
from shaftpose.dataset.coco_images import (
    UNKNOWN_POINT,
    CocoImage,
    CocoInstrument,
    CocoTool,
    Point,
    SquareImage,
)
from shaftpose.dataset.compressed_masks import CompressedMask
from shaftpose.dataset.segmentation import read_segmentation
from shaftpose.image_files.reading import most_pixels
from shaftpose.settings.parsing import parse
from shaftpose.settings.schema import PositiveInt

log = logging.getLogger(__name__)

# Values of a tool's `attributes.shaft` that tell which of its pixels are shaft: those outlined, or
# none, as only its jaws or wrist are visible.
_SHAFT_KNOWN = "outlined", "none"
_NEAR_PX = 2.0  # between the sides of a box and of its mask
_ROUNDING_PX = 1.0  # by which a box may leave its image: annotation tools round its numbers

_Number = Annotated[float, Field(strict=True)]
_Point = tuple[_Number, _Number]

_FINITE = ConfigDict(allow_inf_nan=False)


@pydantic.dataclasses.dataclass(frozen=True)
class _ImageEntry:
    """The fields of an entry of COCO's `images` that are read."""

    id: int
    file_name: str
    width: PositiveInt
    height: PositiveInt
    view: list[list[_Number]] | None = None  # polygons of the visible field
    operation: str = ""


@pydantic.dataclasses.dataclass(frozen=True, config=_FINITE)
class _Annotation:
    """The fields of an entry of COCO's `annotations` that are read."""

    image_id: int
    bbox: Annotated[list[_Number], Field(min_length=4, max_length=4)]  # x, y, width, height
    category_id: Any = None
    segmentation: Any = ()  # `read_segmentation` checks it
    iscrowd: bool = False
    occluded: Annotated[bool, Field(validation_alias=AliasPath("attributes", "occluded"))] = False
    tip: Annotated[_Point | None, Field(validation_alias=AliasPath("attributes", "tip"))] = None
    tail: Annotated[_Point | None, Field(validation_alias=AliasPath("attributes", "tail"))] = None
    shaft: Annotated[Any, Field(validation_alias=AliasPath("attributes", "shaft"))] = None


def read_coco(path: Path) -> list[CocoImage]:
    """The images of a COCO file, ordered by file name.

    Annotations of a category named `tool` are whole instruments. All others except crowds are
    shafts, whatever their category. Crowds (`iscrowd`: 1) are several shafts in one box, or masks
    of CVAT's brush; a warning counts them.
    Raises InputError naming the file and the entry if the file is missing or damaged or lists no
    image, an entry lacks a value or holds a wrong one, an image is listed twice or missing, a tool
    has no mask, or a box leaves its image by more than a pixel.
    """
    content = _read_json(path)
    entries = _image_entries(content["images"], path)
    tool_ids = _tool_ids(content.get("categories"))
    shafts: defaultdict[int, list[CocoInstrument]] = defaultdict(list)
    crowds: defaultdict[int, list[CocoInstrument]] = defaultdict(list)
    tools: defaultdict[int, list[CocoTool]] = defaultdict(list)
    for annotation, instrument, where in _instruments(content["annotations"], entries, path):
        if annotation.category_id in tool_ids:
            tools[annotation.image_id].append(_tool(annotation, instrument, where))
        else:
            group = crowds if annotation.iscrowd else shafts
            group[annotation.image_id].append(instrument)
    if crowds:
        log.warning(
            "%s: left out %d annotations with iscrowd 1, several shafts in one or masks of CVAT's "
            "brush; outline each shaft by a polygon, or set iscrowd to 0",
            path,
            sum(map(len, crowds.values())),
        )
    images = [
        CocoImage(
            file,
            entry.width,
            entry.height,
            instruments=tuple(shafts[number]),
            crowds=tuple(crowds[number]),
            tools=tuple(tools[number]),
            field=_field(entry.view, f"{path}: image {entry.file_name}"),
            operation=entry.operation or file.stem,
        )
        for number, (entry, file) in entries.items()
    ]
    return sorted(images, key=lambda image: image.path.name)


def _read_json(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_bytes())
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({error.strerror}); put a COCO file there"
        ) from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: no JSON ({error}); fix or replace it") from error
    for name in ("images", "annotations"):
        if not isinstance(content, dict) or not isinstance(content.get(name), list):
            raise InputError(f"{path}: lacks the list `{name}`; it must be a COCO file")
    return content


def _image_entries(images: list[Any], path: Path) -> dict[int, tuple[_ImageEntry, Path]]:
    """Entries and image files by the entries' ids."""
    if not images:
        raise InputError(f"{path}: lists no image; add one or more to `images`")
    entries: dict[int, tuple[_ImageEntry, Path]] = {}
    files: set[Path] = set()
    for n, values in enumerate(images):
        where = f"{path}: images[{n}]"
        entry = parse(_ImageEntry, values, f"{where}.")
        if entry.width * entry.height > most_pixels():  # of its masks, too
            raise InputError(
                f"{where}: states {entry.width} x {entry.height} px, more than "
                f"{os.environ[MOST_PIXELS]} in all; fix width and height, or set {MOST_PIXELS}"
            )
        if entry.id in entries:
            raise InputError(f"{where}.id = {entry.id}: another image has this id; change one")
        file = _file_of(entry.file_name, path.parent, f"{where}.file_name")
        if file in files:
            raise InputError(
                f"{where}.file_name = {entry.file_name!r}: listed twice; remove one entry and "
                "give its annotations to the other"
            )
        entries[entry.id] = entry, file
        files.add(file)
    return entries


def _file_of(name: str, folder: Path, where: str) -> Path:
    """The image file of an entry: its name is relative to the folder or, from CVAT, to `images`.

    Of a name from Label Studio, an address or a path on its server, perhaps with backslashes, only
    the last part counts, and the file is in `images`. For other paths, this would take the image of
    the same name of another folder.
    """
    windows, stated = PureWindowsPath(name), PurePath(name.replace("\\", "/"))
    is_elsewhere = stated.is_absolute() or windows.drive or ".." in stated.parts or "://" in name
    places = [] if is_elsewhere else [folder / stated, folder / "images" / stated]
    if is_elsewhere or "\\" in name:
        places.append(folder / "images" / stated.name)
    for place in places:
        if os.path.isfile(place):  # unlike Path.is_file, no error for a folder without permission
            return place
    raise InputError(
        f"{where} = {name!r}: no such file in {folder} or its `images`; add it or remove its entry"
    )


def _instruments(
    annotations: list[Any], entries: Mapping[int, tuple[_ImageEntry, Path]], path: Path
) -> Iterator[tuple[_Annotation, CocoInstrument, str]]:
    """Annotations, what they outline, and where they are written."""
    for n, values in enumerate(annotations):
        where = f"{path}: annotations[{n}]"
        annotation = parse(_Annotation, values, f"{where}.")
        if annotation.image_id not in entries:
            raise InputError(
                f"{where}.image_id = {annotation.image_id}: no image has this id; "
                "list the image or remove the annotation"
            )
        entry, _ = entries[annotation.image_id]
        yield annotation, _instrument(annotation, entry, where), where


def _tool_ids(categories: Any) -> list[Any]:
    entries = categories if isinstance(categories, list) else []
    return [e.get("id") for e in entries if isinstance(e, dict) and _is_tool(e.get("name"))]


def _is_tool(name: object) -> bool:
    return isinstance(name, str) and name.casefold() == "tool"


def _tool(annotation: _Annotation, whole: CocoInstrument, where: str) -> CocoTool:
    if whole.mask is None:
        raise InputError(
            f"{where}: a `tool` without `segmentation`; add its polygons, or name its category "
            "`shaft`"
        )
    return CocoTool(whole.mask, shaft_known=annotation.shaft in _SHAFT_KNOWN)


def _field(view: list[list[float]] | None, where: str) -> tuple[Point, ...] | None:
    """The convex hull of the polygons x, y, x, y, ... of a visible field."""
    if not view:
        return None
    if any(len(polygon) % 2 or len(polygon) < 6 for polygon in view):
        raise InputError(f"{where}: a polygon of `view` is not x and y of three points or more")
    points = np.concatenate(view, dtype=np.float32).reshape(-1, 1, 2)
    return tuple((float(x), float(y)) for x, y in cv2.convexHull(points)[:, 0])


def _instrument(annotation: _Annotation, entry: _ImageEntry, where: str) -> CocoInstrument:
    """The instrument, or crowd, of an annotation, with its box clipped to the image."""
    mask = None if annotation.iscrowd else _mask(annotation.segmentation, entry, where)
    if mask is not None and _states_corners(annotation.bbox, mask.extent):
        raise InputError(
            f"{where}: the box {annotation.bbox} holds the corners of its `segmentation`; write x, "
            f"y, width, height: {mask.extent}"
        )
    x, y, width, height = annotation.bbox
    corners = np.array([[x, y], [x + width, y + height]])
    clipped = np.clip(corners, 0, [entry.width, entry.height])
    if np.any(clipped[0] >= clipped[1]) or np.abs(corners - clipped).max() > _ROUNDING_PX:
        raise InputError(
            f"{where}: the box {annotation.bbox} of {entry.file_name} is empty or leaves the "
            f"image of {entry.width} x {entry.height}; fix the box"
        )
    if annotation.tip is not None and annotation.tip == annotation.tail:
        raise InputError(
            f"{where}: tip and tail are the same point {annotation.tip}, which gives no axis; move "
            "the tail towards the handle, or remove it"
        )
    (x0, y0), (x1, y1) = clipped.tolist()
    axis = (annotation.tip or UNKNOWN_POINT, annotation.tail or UNKNOWN_POINT)
    return CocoInstrument((x0, y0, x1, y1), mask, annotation.occluded, axis)


def _states_corners(box: list[float], extent: list[float]) -> bool:
    """Whether a box is x0, y0, x1, y1 of an extent x, y, width, height."""
    x, y, width, height = extent
    corners = [x, y, x + width, y + height]
    alike = (np.abs(np.subtract(box, other)).max() <= _NEAR_PX for other in (extent, corners))
    return tuple(alike) == (False, True)


def _mask(segmentation: Any, entry: _ImageEntry, where: str) -> CompressedMask | None:
    size = entry.height, entry.width
    return read_segmentation(segmentation, size, entry.file_name, f"{where}.segmentation")


def check_masks(images: Sequence[CocoImage], path: Path) -> None:
    """Raise InputError naming the first shaft of a COCO file that has a box but no mask."""
    for image in images:
        for instrument in image.instruments:
            if instrument.mask is None:
                raise InputError(
                    f"{path}: the shaft of {image.path.name} in the box {instrument.box} "
                    "(x0, y0, x1, y1) has no pixel in `segmentation`, which tests need; add its "
                    "polygons"
                )


def write_coco(
    path: Path, images: Sequence[tuple[str, SquareImage]], with_masks: bool, description: str
) -> None:
    """Write the annotations of images, given with their file names, as a COCO file."""
    content: dict[str, Any] = {
        "info": {"description": description},
        "images": [],
        "annotations": [],
        "categories": [{"id": 1, "name": "shaft"}],
    }
    for number, (name, image) in enumerate(images, start=1):
        height, width = image.rgb.shape[:2]
        content["images"].append(
            {"id": number, "file_name": name, "width": width, "height": height}
        )
        parts = zip(image.boxes.tolist(), image.masks, image.axes, strict=True)
        for box, mask, axis in parts:
            known = zip(("tip", "tail"), axis, strict=True)
            points = {name: point.tolist() for name, point in known if np.isfinite(point).all()}
            content["annotations"].append(
                {
                    "id": len(content["annotations"]) + 1,
                    "image_id": number,
                    "category_id": 1,
                    "iscrowd": 0,
                    "bbox": [box[0], box[1], box[2] - box[0], box[3] - box[1]],
                    "area": int(mask.sum()),
                    "segmentation": asdict(CompressedMask.of(mask)) if with_masks else [],
                    "attributes": {"occluded": image.occluded, **points},
                }
            )
    write_json(path, content)
