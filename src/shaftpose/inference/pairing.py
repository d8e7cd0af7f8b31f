"""One-to-one pairing of two sets."""

import numpy as np

from shaftpose.core.geometry import Array


def nearest_pairs(distances: Array, most: float) -> dict[int, int]:
    """Row -> column of distances (N, M) up to `most`, nearest first, each in one pair at most."""
    near = np.argwhere(distances <= most)
    order = np.argsort(distances[tuple(near.T)], kind="stable")
    pairs: dict[int, int] = {}
    taken: set[int] = set()
    for row, column in near[order].tolist():
        if row not in pairs and column not in taken:
            pairs[row] = column
            taken.add(column)
    return pairs
