"""Does the exported file do what the PyTorch detector does?"""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from shaftpose.deployment.predictor import Predictor
from shaftpose.instruments import Detections

# Far below what matters, far above what float32 rounding does.
SCORE_TOLERANCE, BOX_TOLERANCE_PX, POSE_TOLERANCE = 0.01, 0.5, 0.5


@dataclass(frozen=True)
class Parity:
    """Largest differences between matched detections; poses in mm and deg.

    missing: detections of PyTorch that the file does not find near their place.
    """

    images: int
    detections: int
    missing: int
    score: float
    box_px: float
    pose: float

    @property
    def holds(self) -> bool:
        """Whether every difference is within its tolerance."""
        return (
            self.missing == 0
            and self.score <= SCORE_TOLERANCE
            and self.box_px <= BOX_TOLERANCE_PX
            and self.pose <= POSE_TOLERANCE
        )


def check_parity(
    detector: nn.Module, predictor: Predictor, images: NDArray[np.uint8], least_score: float = 0.1
) -> Parity:
    """Compare on images (N, 299, 299, 3) uint8 RGB; detections below `least_score` are left out:
    among nearly equal scores, rounding decides which candidate survives."""
    with torch.inference_mode():
        boxes, scores, poses = detector.eval()(torch.from_numpy(images))
    found = predictor(images)
    pairs, missing, total = [], 0, 0
    for n in range(len(images)):
        known = Detections(*(t[n].double().numpy() for t in (boxes, scores, poses)))
        for row in np.flatnonzero(known.scores >= least_score):
            twin = _nearest(found[n], known.boxes[row])
            total += 1
            if twin is None:
                missing += 1
            else:
                pairs.append(_differences(known, int(row), found[n], twin))
    score, box, pose = np.max(pairs, axis=0).tolist() if pairs else (0.0, 0.0, 0.0)
    return Parity(len(images), total, missing, score, box, pose)


def _nearest(found: Detections, box: NDArray[np.float64]) -> int | None:
    """The detection whose corners lie within 5 px of `box`, the nearest of them."""
    if not len(found.boxes):
        return None
    distance = np.abs(found.boxes - box).max(axis=1)
    best = int(distance.argmin())
    return best if distance[best] < 5 else None


def _differences(known: Detections, row: int, found: Detections, twin: int) -> list[float]:
    pose = np.abs(known.poses[row] - found.poses[twin])
    pose[4] = min(pose[4], 360 - pose[4])  # yaw 359.9 and 0.1 are neighbours
    return [
        float(abs(known.scores[row] - found.scores[twin])),
        float(np.abs(known.boxes[row] - found.boxes[twin]).max()),
        float(pose.max()),
    ]
