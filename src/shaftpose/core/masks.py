"""Masks of shafts: their boxes and run lengths, and how far one hides another."""

from collections.abc import Iterable
from dataclasses import dataclass

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
    """The covered share of the mask in `others` of which `front` (H, W) covers most; 0 if there
    are no others."""
    return max(
        (int((front & other).sum()) / int(other.sum()) for other in others if other.any()),
        default=0.0,
    )


def is_crossed(share: float, coverage: tuple[float, float]) -> bool:
    """Whether a hidden share is above 0 and in the range `coverage` (scene.crossing_coverage)."""
    low, high = coverage
    return share > 0 and low <= share <= high


@dataclass(frozen=True)
class RunLengths:
    """A mask as COCO's uncompressed run lengths.

    counts: lengths of the runs of zeros and ones in turn, zeros first, column by column; size:
    height and width.
    """

    counts: list[int]
    size: tuple[int, int]

    @classmethod
    def of(cls, mask: NDArray[np.bool_]) -> "RunLengths":
        """The run lengths of a mask (H, W)."""
        flat = mask.ravel(order="F")
        changes = np.flatnonzero(flat[1:] != flat[:-1]) + 1
        edges = np.concatenate([[0], changes, [flat.size]])
        runs = np.diff(edges).tolist()
        height, width = mask.shape
        return cls([0, *runs] if flat[0] else runs, (height, width))

    def mask(self) -> NDArray[np.bool_]:
        """The mask (H, W). Raises ValueError if a count is negative or the sum is wrong."""
        counts = np.asarray(self.counts, dtype=np.int64)
        values = np.arange(len(counts)) % 2 == 1
        height, width = self.size
        return np.repeat(values, counts).reshape((width, height)).T
