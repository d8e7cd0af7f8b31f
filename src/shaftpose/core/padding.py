"""Removal of the padding of decoded outputs."""

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.instruments import Detections

Floats = NDArray[np.floating]


def unpadded(boxes: Floats, scores: Floats, poses: Floats) -> list[Detections]:
    """Decoded outputs (B, K, 4), (B, K), (B, K, 5) image by image; those of score 0 are padding."""
    arrays = (values.astype(np.float64) for values in (boxes, scores, poses))
    return [Detections(b[s > 0], s[s > 0], p[s > 0]) for b, s, p in zip(*arrays, strict=True)]
