"""Real images: a folder with `images/` and COCO annotations that have boxes but no poses."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from shaftpose.errors import InputError
from shaftpose.images import centre_square, read_rgb

# OpenCV fills in sixteenths of a pixel around centres and adds the outline. On a grid three times
# as fine, whose every third point is a pixel's centre, the outline does not reach the next one.
_SUBPIXEL_BITS = 4
_FINER = 3


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

    @property
    def occluded(self) -> bool:
        """Whether part of any instrument is hidden."""
        return any(instrument.occluded for instrument in self.instruments)


@dataclass(frozen=True)
class RealSample:
    """A real image as the network sees it: rgb (S, S, 3), boxes (G, 4) px, masks G x (S, S)."""

    rgb: NDArray[np.uint8]
    boxes: NDArray[np.float64]
    masks: tuple[NDArray[np.bool_], ...]
    occluded: bool


def read_coco(path: Path) -> list[RealImage]:
    """The images of a COCO file, ordered by file name; names are relative to the file's folder.

    Raises InputError naming the file for a missing or damaged annotation file, an image that is
    not there, and a box that leaves its image.
    """
    content = _read_json(path)
    try:
        return _images(content, path)
    except KeyError as error:
        raise InputError(f"{path}: an image or annotation lacks {error}; add it") from error


def _images(content: dict[str, Any], path: Path) -> list[RealImage]:
    by_image: dict[int, list[RealInstrument]] = {}
    sizes = {entry["id"]: entry for entry in content["images"]}
    for annotation in content["annotations"]:
        entry = sizes.get(annotation["image_id"])
        if entry is None:
            raise InputError(
                f"{path}: annotation {annotation['id']} names image {annotation['image_id']}, "
                "which is not listed; add the image or remove the annotation"
            )
        by_image.setdefault(entry["id"], []).append(_instrument(annotation, entry, path))
    found = [_image(entry, by_image.get(entry["id"], []), path) for entry in sizes.values()]
    return sorted(found, key=lambda image: image.path.name)


def _read_json(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text())
    except OSError as error:
        raise InputError(f"{path}: cannot be read; put a COCO file there") from error
    except ValueError as error:
        raise InputError(f"{path}: no JSON ({error}); mend or replace it") from error
    if not isinstance(content, dict) or not {"images", "annotations"} <= content.keys():
        raise InputError(f"{path}: lacks `images` or `annotations`; it must be a COCO file")
    return content


def _image(entry: dict[str, Any], instruments: list[RealInstrument], path: Path) -> RealImage:
    file = path.parent / entry["file_name"]
    if not file.is_file():
        raise InputError(f"{path}: names {file}, which does not exist; add it or remove its entry")
    return RealImage(file, entry["width"], entry["height"], tuple(instruments))


def _instrument(annotation: dict[str, Any], entry: dict[str, Any], path: Path) -> RealInstrument:
    x, y, width, height = annotation["bbox"]
    inside = x >= 0 and y >= 0 and x + width <= entry["width"] and y + height <= entry["height"]
    if not inside or width <= 0 or height <= 0:
        raise InputError(
            f"{path}: the box {annotation['bbox']} of {entry['file_name']} is empty or leaves the "
            f"image of {entry['width']} x {entry['height']}; mend the box"
        )
    polygons = tuple(
        np.array(points, dtype=np.float64).reshape(-1, 2)
        for points in annotation.get("segmentation", [])
    )
    occluded = bool(annotation.get("attributes", {}).get("occluded", False))
    return RealInstrument((x, y, x + width, y + height), polygons, occluded)


def load_square(image: RealImage, size_px: int) -> RealSample:
    """The central square of a real image, resized, with what remains of its annotations.

    An instrument of whose box less than a fifth lies in the square is dropped.
    """
    rgb = read_rgb(image.path)
    if rgb.shape[:2] != (image.height, image.width):
        raise InputError(
            f"{image.path}: has {rgb.shape[1]} x {rgb.shape[0]} px, its COCO entry says "
            f"{image.width} x {image.height}; mend the entry"
        )
    side = min(image.width, image.height)
    left, top = (image.width - side) // 2, (image.height - side) // 2
    scale = size_px / side
    moved = [_moved(i, np.array([left, top]), scale, size_px) for i in image.instruments]
    kept = [instrument for instrument in moved if instrument is not None]
    return RealSample(
        rgb=centre_square(rgb, size_px),
        boxes=np.array([i.box for i in kept], dtype=np.float64).reshape(-1, 4),
        masks=tuple(polygon_mask(i.polygons, size_px) for i in kept),
        occluded=image.occluded,
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
    """(size, size) mask of polygons whose coordinates count from the image's upper left corner."""
    mask = np.zeros((_FINER * size_px, _FINER * size_px), dtype=np.uint8)
    scale = 1 << _SUBPIXEL_BITS
    points = [np.rint((polygon * _FINER - 0.5) * scale).astype(np.int32) for polygon in polygons]
    cv2.fillPoly(mask, points, (1,), shift=_SUBPIXEL_BITS)
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
    path.write_text(json.dumps(content, indent=1) + "\n")
