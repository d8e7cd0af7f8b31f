"""Detections whose poses were fitted."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.instruments import Detections


@dataclass(frozen=True)
class FittedDetections(Detections):
    """Detections with the standard deviations of their poses, (K, 5) mm and deg; NaN where a pose
    could not be fitted and is the network's."""

    deviations: NDArray[np.float64]
