"""Masks of shafts: their boxes and run lengths, and how far one hides another."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray


def mask_box(mask: NDArray[np.bool_]) -> tuple[int, int, int, int]:
    """Bounding box x0, y0, x1, y1 of a mask (pixel edges: x1 and y1 are exclusive).

    Raises ValueError if the mask is empty.
    """
    columns, rows = np.flatnonzero(mask.any(axis=0)), np.flatnonzero(mask.any(axis=1))
    if not len(columns):
        raise ValueError("an empty mask has no box")
    return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1


def crossed_share(front: NDArray[np.bool_], others: Iterable[NDArray[np.bool_]]) -> float:
    """The largest share of a mask in `others` that the mask `front` (H, W) covers; 0 if there
    are no others."""
    return max(
        (int((front & other).sum()) / int(other.sum()) for other in others if other.any()),
        default=0.0,
    )


def is_crossed(share: float, coverage: tuple[float, float]) -> bool:
    """Whether a shaft with this share hidden counts as crossed by `crossing_coverage`."""
    low, high = coverage
    return share > 0 and low <= share <= high


def encode_mask(mask: NDArray[np.bool_]) -> dict[str, Any]:
    """COCO's uncompressed run lengths of an (H, W) mask, column by column, starting with zeros."""
    flat = mask.ravel(order="F")
    changes = np.flatnonzero(flat[1:] != flat[:-1]) + 1
    edges = np.concatenate([[0], changes, [flat.size]])
    runs = np.diff(edges).tolist()
    return {"counts": [0, *runs] if flat[0] else runs, "size": list(mask.shape)}


def decode_mask(encoded: Mapping[str, Any]) -> NDArray[np.bool_]:
    """Inverse of `encode_mask`: an (H, W) mask."""
    counts = np.asarray(encoded["counts"], dtype=np.int64)
    values = np.arange(len(counts)) % 2 == 1
    height, width = encoded["size"]
    return np.repeat(values, counts).reshape((width, height)).T
