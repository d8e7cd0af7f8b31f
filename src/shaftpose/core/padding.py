"""Removal of the padding of decoded outputs."""

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.instruments import Detections
from shaftpose.errors import InputError

Floats = NDArray[np.floating]


def unpadded(boxes: Floats, scores: Floats, poses: Floats) -> list[Detections]:
    """Decoded outputs (B, K, 4), (B, K), (B, K, 5) image by image; those of score 0 are padding.

    Raises InputError if one of them is NaN or infinite: it would compare as no detection, or spoil
    means.
    """
    arrays = [values.astype(np.float64) for values in (boxes, scores, poses)]
    if not all(np.isfinite(values).all() for values in arrays):
        raise InputError(
            "the model finds boxes, scores or poses that are not finite: export it again, or train "
            "it again"
        )
    return [Detections(b[s > 0], s[s > 0], p[s > 0]) for b, s, p in zip(*arrays, strict=True)]
