"""Frames whose shafts are whole rows of a small picture."""

from typing import Any

import numpy as np

from shaftpose.metrics.frames.comparison import FoundShafts, TrueShafts

HEIGHT, WIDTH = 10, 20


def band(first: int, last: int, start: int = 0, end: int = WIDTH) -> np.ndarray:
    """A mask of the rows `first` to `last`, columns `start` to `end` exclusive."""
    mask = np.zeros((HEIGHT, WIDTH), dtype=bool)
    mask[first : last + 1, start:end] = True
    return mask


NOTHING = np.zeros((HEIGHT, WIDTH), dtype=bool)


def box_of(mask: np.ndarray) -> list[int]:
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return [columns[0], rows[0], columns[-1] + 1, rows[-1] + 1]


def axis_of(mask: np.ndarray) -> list[list[float]]:
    """From a tip at its left to a tail at its right, along its middle."""
    x0, y0, x1, y1 = box_of(mask)
    return [[x0, (y0 + y1) / 2], [x1, (y0 + y1) / 2]]


def true_shafts(*masks: np.ndarray, **more: Any) -> TrueShafts:
    values = {
        "boxes": np.array([box_of(mask) for mask in masks]).reshape(-1, 4),
        "axes": np.array([axis_of(mask) for mask in masks]).reshape(-1, 2, 2),
        "ignored": NOTHING,
        "tools": None,
        "hidden_shares": np.zeros(len(masks)),
        "groups": {},
    }
    return TrueShafts(**{"masks": masks, **values, **more})


def found_shafts(*scored: tuple[float, np.ndarray], tools: Any = None) -> FoundShafts:
    masks = [mask for _, mask in scored]
    return FoundShafts(
        scores=np.array([score for score, _ in scored]),
        boxes=np.array([box_of(mask) for mask in masks]).reshape(-1, 4),
        masks=masks,
        axes=np.array([axis_of(mask) for mask in masks]).reshape(-1, 2, 2),
        tools=tools,
    )
