"""COCO masks: conversion between pixels, run lengths and polygons with pycocotools.

A mask is stored as COCO's compressed run lengths: `size` (height, width) and `counts` (text).
"""

import re
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from pycocotools import mask as coco_mask

RunLengths = dict[str, Any]
Pixels = NDArray[np.uint8]  # (H, W), 1 in the mask

# Numbers of one to six characters that end with one of 0 to O. If this end is missing, pycocotools
# reads beyond the text.
_COMPRESSED = re.compile("([P-o]{0,5}[0-O])+")


def encode(mask: NDArray[Any]) -> RunLengths:
    """The run lengths of a mask (H, W)."""
    return _as_text(coco_mask.encode(np.asfortranarray(mask, dtype=np.uint8)))


def _as_text(encoded: dict[str, Any]) -> RunLengths:
    """Run lengths with counts as text for JSON; pycocotools writes bytes and reads both."""
    return {"size": encoded["size"], "counts": encoded["counts"].decode()}


def decode(encoded: RunLengths) -> Pixels:
    """The mask (H, W) of valid run lengths."""
    return np.asarray(coco_mask.decode(encoded), dtype=np.uint8)


def unite(polygons: Sequence[NDArray[np.float64]], size: list[int]) -> RunLengths:
    """The union of one or more polygons x, y, x, y, ... in an image of `size` rows, columns."""
    return _as_text(coco_mask.merge(coco_mask.frPyObjects(list(polygons), *size)))


def area(encoded: RunLengths) -> int:
    """The number of pixels in a mask."""
    return int(coco_mask.area(encoded))


def decode_counts(counts: Any, size: list[int]) -> Pixels | None:
    """The mask of counts (list or text) from a file; None unless they add up to its pixels."""
    if isinstance(counts, str):
        return _decode_text(counts, size)
    numbers = isinstance(counts, list) and all(isinstance(n, int) and n >= 0 for n in counts)
    if not numbers or sum(counts) != size[0] * size[1]:
        return None
    return decode(coco_mask.frPyObjects({"counts": counts, "size": size}, *size))


def _decode_text(counts: str, size: list[int]) -> Pixels | None:
    if not _COMPRESSED.fullmatch(counts):
        return None
    try:
        mask = decode({"counts": counts, "size": size})
    except ValueError:  # they add up to more pixels
        return None
    # If they add up to fewer, the rest is undefined, and encoding gives different run lengths.
    return mask if encode(mask)["counts"] == counts else None


def without_holes(mask: Pixels) -> Pixels:
    """The mask (H, W) with holes filled and without parts of one or two pixels."""
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    parts = [contour for contour in contours if len(contour) >= 3]
    filled = np.zeros(mask.shape, dtype=np.uint8)
    cv2.drawContours(filled, parts, -1, (1,), cv2.FILLED)
    return filled
