"""Comparison of an exported file with the PyTorch detector."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from shaftpose.core.instruments import Detections, unpadded
from shaftpose.export.onnx_export import ShaftDetector
from shaftpose.inference.learned_edges import LearnedEdges
from shaftpose.inference.predictor import Predictor
from shaftpose.metrics.detection.matching import box_iou, nearest_pairs
from shaftpose.refinement.contour_sampling import COLUMNS, ROWS

# Far below relevant differences, far above float32 rounding.
SCORE_TOLERANCE, BOX_TOLERANCE_PX, POSE_TOLERANCE = 0.01, 0.5, 0.01
MASK_TOLERANCE = 0.001
EDGE_TOLERANCE = 0.001  # columns, and logarithms
_STRIPS = 16
TIE = 1e-4
# Share of detections whose pose classes may differ, because rounding decides between equal logits.
# An untrained network had 0.2 %.
JUMPS = 0.01


@dataclass(frozen=True)
class Parity:
    """Counts of detections by PyTorch and by the file, and the largest differences between both.

    detections: of PyTorch. missing: without a counterpart in the file. extra: only in the file.
    tied: on one side alone, because rounding decided between equal scores. jumped: with poses that
    differ by more than the tolerance; `jumps_allowed` are accepted. score, box_px, pose (mm or
    deg): largest differences of detections on both sides. mask: largest difference of the
    masks' probabilities (shaft and instrument); None without masks. edge: of the edge reader's
    offsets, in columns of its strips, and of the logarithms of their errors; None without an edge
    reader.
    """

    images: int
    detections: int
    tied: int
    missing: int
    extra: int
    jumped: int
    jumps_allowed: int
    score: float
    box_px: float
    pose: float
    mask: float | None = None
    edge: float | None = None

    @property
    def holds(self) -> bool:
        """Whether nothing is missing or extra and the differences are within their tolerances."""
        same = self.missing == self.extra == 0 and (self.mask or 0.0) <= MASK_TOLERANCE
        same &= (self.edge or 0.0) <= EDGE_TOLERANCE
        return same and self.score <= SCORE_TOLERANCE and self.jumped <= self.jumps_allowed


def check_parity(
    detector: ShaftDetector,
    predictor: Predictor,
    images: NDArray[np.uint8],
    least_score: float = 0.1,
    continuous: bool = True,
) -> Parity:
    """Compare the detections of at least `least_score` in images (N, S, S, 3) uint8 RGB; all,
    if a barely trained network has none of that score.

    continuous: whether the poses are numbers instead of classes.
    """
    with torch.inference_mode():
        outputs = detector.eval()(torch.from_numpy(images))
    boxes, scores, poses = (values.double().numpy() for values in outputs[:3])
    least_score = least_score if np.any(scores >= least_score) else 0.0
    detections, differences, singles = 0, [(0.0, 0.0, 0.0)], Counter[str]()
    for known, found in zip(unpadded(boxes, scores, poses), predictor(images), strict=True):
        detections += int(np.sum(known.scores >= least_score))
        pairs = _pairs(known, found)
        differences += [
            _differences(known, row, found, twin)
            for row, twin in pairs.items()
            if known.scores[row] >= least_score
        ]
        singles += _verdicts(_singles(known, found, pairs, boxes.shape[1]), least_score)
    score, box_px, pose = np.max(differences, axis=0).tolist()
    return Parity(
        images=len(images),
        detections=detections,
        tied=singles["tied"],
        missing=singles["missing"],
        extra=singles["extra"],
        # Not `>`, which a NaN pose would pass.
        jumped=sum(not apart <= POSE_TOLERANCE for _, _, apart in differences),
        jumps_allowed=0 if continuous else math.ceil(JUMPS * detections),
        score=score,
        box_px=box_px,
        pose=pose,
    )


def mask_difference(
    detector: ShaftDetector, predictor: Predictor, images: NDArray[np.uint8]
) -> float:
    """The largest difference between the masks of a network and of its file, in images
    (N, S, S, 3) uint8 RGB."""
    with torch.inference_mode():
        *_, shafts, tools = detector.eval()(torch.from_numpy(images))
    pairs = (shafts, predictor.masks(images)), (tools, predictor.tools(images))
    return float(np.max([np.abs(one.numpy() - other).max() for one, other in pairs]))


def edge_difference(reader: nn.Module, edges: LearnedEdges) -> float:
    """The largest difference between the outputs of a reader and of its file for random strips."""
    strips = np.random.default_rng(0).uniform(-1, 1, (_STRIPS, ROWS, COLUMNS, 3)).astype(np.float32)
    with torch.inference_mode():
        expected = reader.cpu().eval()(torch.from_numpy(strips.transpose(0, 3, 1, 2)))
    pairs = zip(expected, edges.read(strips), strict=True)
    return float(np.max([np.abs(one.numpy() - other) for one, other in pairs]))  # NaN if one is NaN


def _pairs(known: Detections, found: Detections) -> dict[int, int]:
    """Row of `known` -> row of `found` for boxes whose corners agree within the tolerance, see
    `nearest_pairs`."""
    distances = np.abs(known.boxes[:, None] - found.boxes[None]).max(axis=2)
    return nearest_pairs(distances, BOX_TOLERANCE_PX)


def _differences(
    known: Detections, row: int, found: Detections, twin: int
) -> tuple[float, float, float]:
    """The differences of score, box and pose."""
    pose = np.abs(known.poses[row] - found.poses[twin])
    pose[4] = min(pose[4], 360 - pose[4])  # yaw 359.9 and 0.1 are neighbours
    return (
        float(abs(known.scores[row] - found.scores[twin])),
        float(np.abs(known.boxes[row] - found.boxes[twin]).max()),
        float(pose.max()),
    )


@dataclass(frozen=True, eq=False)
class _Single:
    """A detection on one side alone.

    crowded_out: both lists are full, and the other holds only equal or higher scores.
    """

    box: NDArray[np.float64]
    score: float
    in_file: bool
    crowded_out: bool


def _singles(
    known: Detections, found: Detections, pairs: Mapping[int, int], most: int
) -> list[_Single]:
    """The detections without a pair; each side lists at most `most`."""
    full = len(known.boxes) == len(found.boxes) == most
    singles = []
    for own, other, paired, in_file in (
        (known, found, pairs.keys(), False),
        (found, known, pairs.values(), True),
    ):
        for row in set(range(len(own.boxes))) - set(paired):
            crowded_out = full and bool(own.scores[row] <= other.scores.min() + TIE)
            singles.append(_Single(own.boxes[row], own.scores[row], in_file, crowded_out))
    return singles


def _verdicts(singles: Sequence[_Single], least_score: float) -> Counter[str]:
    """Counts of "tied", "missing" and "extra" detections with at least `least_score`.

    Rounding decides which of two overlapping boxes of equal score is kept. Boxes that only one of
    the two suppresses are tied, too. A barely trained network ties often.
    """
    tied: list[_Single] = []
    for single in sorted(singles, key=lambda single: -single.score):
        rivals = (o for o in singles if o.in_file != single.in_file and _overlap(o, single))
        if single.crowded_out or any(
            abs(rival.score - single.score) <= TIE or rival in tied for rival in rivals
        ):
            tied.append(single)
    return Counter(
        "tied" if single in tied else "extra" if single.in_file else "missing"
        for single in singles
        if single.score >= least_score
    )


def _overlap(a: _Single, b: _Single) -> bool:
    return bool(box_iou(a.box[None], b.box[None])[0, 0] > 0)
