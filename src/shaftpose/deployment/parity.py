"""Does the exported file do what the PyTorch detector does?"""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from shaftpose.deployment.predictor import Predictor
from shaftpose.geometry import box_iou
from shaftpose.instruments import Detections

# Far below what matters, far above what float32 rounding does.
SCORE_TOLERANCE, BOX_TOLERANCE_PX, POSE_TOLERANCE = 0.01, 0.5, 0.5
TIE = 1e-4


@dataclass(frozen=True)
class Parity:
    """Largest differences between matched detections; poses in mm and deg.

    tied: detections of PyTorch that the file replaced by a neighbour of equal score; missing: those
    without such an excuse.
    """

    images: int
    detections: int
    tied: int
    missing: int
    score: float
    box_px: float
    pose: float

    @property
    def holds(self) -> bool:
        """Whether nothing is missing and every difference is within its tolerance."""
        return self.missing == 0 and self.score <= SCORE_TOLERANCE and self.pose <= POSE_TOLERANCE


def check_parity(
    detector: nn.Module, predictor: Predictor, images: NDArray[np.uint8], least_score: float = 0.1
) -> Parity:
    """Compare the detections of at least `least_score` in images (N, 299, 299, 3) uint8 RGB."""
    with torch.inference_mode():
        boxes, scores, poses = detector.eval()(torch.from_numpy(images))
    found = predictor(images)
    pairs, tied, missing = [], 0, 0
    for n in range(len(images)):
        known = Detections(*(t[n].double().numpy() for t in (boxes, scores, poses)))
        for row in np.flatnonzero(known.scores >= least_score):
            twin = _twin(found[n], known.boxes[row])
            if twin is not None:
                pairs.append(_differences(known, int(row), found[n], twin))
            elif _lost_a_tie(found[n], known.boxes[row], known.scores[row]):
                tied += 1
            else:
                missing += 1
    score, box, pose = np.max(pairs, axis=0).tolist() if pairs else (0.0, 0.0, 0.0)
    return Parity(len(images), len(pairs) + tied + missing, tied, missing, score, box, pose)


def _twin(found: Detections, box: NDArray[np.float64]) -> int | None:
    """The detection whose corners lie nearest to those of `box`, if within the tolerance."""
    if not len(found.boxes):
        return None
    distance = np.abs(found.boxes - box).max(axis=1)
    best = int(distance.argmin())
    return best if distance[best] <= BOX_TOLERANCE_PX else None


def _lost_a_tie(found: Detections, box: NDArray[np.float64], score: float) -> bool:
    """Whether rounding alone may have dropped a detection: an overlapping one has the same score,
    or the file's list is full of scores as good. A network that is hardly trained ties often."""
    if not len(found.boxes):
        return False
    equal = np.abs(found.scores - score) <= TIE
    overlapping = box_iou(found.boxes, box[None])[:, 0] > 0
    return bool((equal & overlapping).any() or found.scores.min() >= score - TIE)


def _differences(known: Detections, row: int, found: Detections, twin: int) -> list[float]:
    pose = np.abs(known.poses[row] - found.poses[twin])
    pose[4] = min(pose[4], 360 - pose[4])  # yaw 359.9 and 0.1 are neighbours
    return [
        float(abs(known.scores[row] - found.scores[twin])),
        float(np.abs(known.boxes[row] - found.boxes[twin]).max()),
        float(pose.max()),
    ]
