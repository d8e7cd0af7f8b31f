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

    def above(self, score: float) -> "FittedDetections":
        """Only the detections whose score is at least `score`."""
        chosen = self.scores >= score
        return FittedDetections(
            self.boxes[chosen], self.scores[chosen], self.poses[chosen], self.deviations[chosen]
        )
