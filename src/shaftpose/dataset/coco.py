"""COCO files: annotations of real images, which have boxes and no poses, next to `images/`."""

import json
import logging
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path, PurePath, PureWindowsPath
from typing import Annotated, Any

import numpy as np
import pydantic
from numpy.typing import NDArray
from pydantic import AliasPath, ConfigDict, Field

from shaftpose.core.errors import InputError
from shaftpose.core.files import write_json
from shaftpose.dataset import run_lengths
from shaftpose.dataset.polygons import crossing
from shaftpose.dataset.real_images import UNKNOWN_POINT, RealImage, RealInstrument, RealSample
from shaftpose.dataset.run_lengths import RunLengths
from shaftpose.settings.parsing import parse
from shaftpose.settings.schema import PositiveInt

log = logging.getLogger(__name__)

_ROUNDING_PX = 1.0  # by which a box may leave its image: annotation tools round its numbers
_FARTHEST_PX = 100_000  # pycocotools needs memory for each pixel that a polygon's outline passes


_Number = Annotated[float, Field(strict=True)]
_Point = tuple[_Number, _Number]

_FINITE = ConfigDict(allow_inf_nan=False)


@pydantic.dataclasses.dataclass(frozen=True)
class _ImageEntry:
    """What is read of one of COCO's `images`."""

    id: int
    file_name: str
    width: PositiveInt
    height: PositiveInt


@pydantic.dataclasses.dataclass(frozen=True, config=_FINITE)
class _Annotation:
    """What is read of one of COCO's `annotations`."""

    image_id: int
    bbox: Annotated[list[_Number], Field(min_length=4, max_length=4)]  # x, y, width, height
    segmentation: Any = ()  # `_mask` checks it
    iscrowd: bool = False
    occluded: Annotated[bool, Field(validation_alias=AliasPath("attributes", "occluded"))] = False
    tip: Annotated[_Point | None, Field(validation_alias=AliasPath("attributes", "tip"))] = None
    tail: Annotated[_Point | None, Field(validation_alias=AliasPath("attributes", "tail"))] = None


def read_coco(path: Path) -> list[RealImage]:
    """The images of a COCO file, ordered by file name; see `_file_of` for where they are.

    Every annotation is a shaft, whatever its category, but for crowds (`iscrowd`: 1), which are
    several shafts in one box, or masks of CVAT's brush; a warning counts them.
    Raises InputError naming the file and the entry for a missing or damaged annotation file, one
    without images, entries that lack a value or hold a wrong one, an image that is listed twice or
    not there, and a box that leaves its image by more than a pixel.
    """
    content = _read_json(path)
    entries = _image_entries(content["images"], path)
    instruments: dict[int, list[RealInstrument]] = {number: [] for number in entries}
    crowds: dict[int, list[RealInstrument]] = {number: [] for number in entries}
    for n, values in enumerate(content["annotations"]):
        where = f"{path}: annotations[{n}]"
        annotation = parse(_Annotation, values, where)
        if annotation.image_id not in entries:
            raise InputError(
                f"{where}.image_id = {annotation.image_id}: no image has this id; "
                "list the image or remove the annotation"
            )
        entry, _ = entries[annotation.image_id]
        if annotation.iscrowd:
            boxed = replace(annotation, segmentation=())
            crowds[entry.id].append(_instrument(boxed, entry, where))
        else:
            instruments[entry.id].append(_instrument(annotation, entry, where))
    if count := sum(map(len, crowds.values())):
        log.warning(
            "%s: left out %d annotations with iscrowd 1, several shafts in one or masks of CVAT's "
            "brush; outline each shaft by a polygon, or set iscrowd to 0",
            path,
            count,
        )
    found = [
        RealImage(
            file, entry.width, entry.height, tuple(instruments[number]), tuple(crowds[number])
        )
        for number, (entry, file) in entries.items()
    ]
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


def _image_entries(images: list[Any], path: Path) -> dict[int, tuple[_ImageEntry, Path]]:
    """Entries and image files by the entries' ids."""
    if not images:
        raise InputError(f"{path}: lists no image; add one or more to `images`")
    entries: dict[int, tuple[_ImageEntry, Path]] = {}
    files: set[Path] = set()
    for n, values in enumerate(images):
        where = f"{path}: images[{n}]"
        entry = parse(_ImageEntry, values, where)
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
    """The image that an entry names: relative to the folder or, as CVAT writes it, to its `images`.

    Label Studio's names may begin with places of its server, and contain backslashes: for these,
    the file in `images` with the last part of the name.
    """
    stated = PurePath(name)
    places = [folder / "images" / PureWindowsPath(name).name]  # which splits at slashes, too
    if not stated.is_absolute() and ".." not in stated.parts:
        places = [folder / stated, folder / "images" / stated, *places]
    for place in places:
        if os.path.isfile(place):  # False, unlike Path's method, where a folder may not be entered
            return place
    raise InputError(
        f"{where} = {name!r}: no such file in {folder} or its `images`; add it or remove its entry"
    )


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
    mask = _mask(annotation.segmentation, entry, f"{where}.segmentation")
    axis = (annotation.tip or UNKNOWN_POINT, annotation.tail or UNKNOWN_POINT)
    if annotation.tip is not None and annotation.tip == annotation.tail:
        raise InputError(
            f"{where}: tip and tail are the same point {annotation.tip}, which gives no axis; move "
            "the tail towards the handle, or remove it"
        )
    return RealInstrument((x0, y0, x1, y1), mask, annotation.occluded, axis)


def _mask(segmentation: Any, entry: _ImageEntry, where: str) -> RunLengths | None:
    """COCO's polygons or run lengths as a mask; None if they have no pixel in the image."""
    if isinstance(segmentation, dict):
        mask = _filled(segmentation, entry, where)
    elif isinstance(segmentation, list | tuple):
        polygons = [_polygon(points, f"{where}[{n}]") for n, points in enumerate(segmentation)]
        if not polygons:
            return None
        mask = run_lengths.unite(polygons, [entry.height, entry.width])
    else:
        raise InputError(f"{where} = {segmentation!r}: must be a list of polygons or run lengths")
    return mask if run_lengths.area(mask) else None


def _polygon(points: Any, where: str) -> NDArray[np.float64]:
    try:
        values = np.array(points, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(
            f"{where}: holds more than numbers; a polygon is x, y, x, y, ..."
        ) from error
    near = np.all(np.abs(values) <= _FARTHEST_PX)  # False for what is no number, too
    if values.ndim != 1 or values.size % 2 or values.size < 6 or not near:
        raise InputError(
            f"{where}: must hold x and y of three points or more, x, y, x, y, ..., none farther "
            f"than {_FARTHEST_PX:,} px; mend the polygon"
        )
    if (at := crossing(values)) is not None:
        raise InputError(
            f"{where}: two of its sides cross at x, y = {at[0]:.1f}, {at[1]:.1f}; move its "
            "corners, or write two polygons"
        )
    return values


def _filled(encoded: dict[str, Any], entry: _ImageEntry, where: str) -> RunLengths:
    """COCO's run lengths without holes and specks."""
    size = [entry.height, entry.width]
    counts = encoded.get("counts") if encoded.get("size") == size else None
    mask = run_lengths.decode_counts(counts, size)
    if mask is None:
        raise InputError(
            f"{where}: run lengths need the size {size} of {entry.file_name} (height, width) and "
            "counts that add up to its pixels; mend them or write polygons"
        )
    return run_lengths.encode(run_lengths.without_holes(mask))


def check_masks(images: Sequence[RealImage], path: Path) -> None:
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
    path: Path, images: Sequence[tuple[str, RealSample]], with_masks: bool, description: str
) -> None:
    """Write samples, given with their file names, as a COCO file; masks only if asked for."""
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
        parts = zip(sample.boxes.tolist(), sample.masks, sample.axes, strict=True)
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
                    "segmentation": run_lengths.encode(mask) if with_masks else [],
                    "attributes": {"occluded": sample.occluded, **points},
                }
            )
    write_json(path, content)
