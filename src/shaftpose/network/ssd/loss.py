"""The paper's loss (III-E): L = (L_conf + alpha L_bbox + L_pose) / n.

n is the number of matched default boxes in the batch, at least 1. `matching` selects these boxes,
`mining` selects the background boxes that count. `box_coding` and the network's `PoseCoder` define
how the outputs code boxes and poses.

A distributed training splits a batch among R ranks and averages their gradients. Each rank
therefore divides by n / R, where n is that of the whole batch: the mean of the ranks' losses,
(1 / R) sum_r L_r / (n / R) = sum_r L_r / n, equals the loss of one process with the whole batch.
"""

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from shaftpose.dataset.batches import Targets
from shaftpose.network import ranks
from shaftpose.network.smooth_l1 import smooth_l1
from shaftpose.network.ssd.box_coding import encode_boxes
from shaftpose.network.ssd.heads import HeadOutputs
from shaftpose.network.ssd.matching import match_boxes
from shaftpose.network.ssd.mining import hard_negatives
from shaftpose.network.ssd.pose_coding import PoseCoder

NEGATIVE_RATIO = 3  # mined background boxes per matched box, as in SSD


class LossTerms(NamedTuple):
    """Scalars: the loss L, its terms L_conf / n, L_bbox / n and L_pose / n, and matched boxes."""

    loss: Tensor
    confidence: Tensor
    box: Tensor
    pose: Tensor
    matched: Tensor


class Assignment(NamedTuple):
    """The training target of each default box.

    truth: (B, A) int64 index of a ground truth (0 where there is none); positive: (B, A) bool,
    matched; negative: (B, A) bool, the mined hard negatives.
    """

    truth: Tensor
    positive: Tensor
    negative: Tensor


class ShaftLoss(nn.Module):
    """The loss: `alpha` weights L_bbox, `beta` (5,) pose dimensions; `gamma` scales pose errors."""

    beta: Tensor

    def __init__(self, alpha: float, beta: Sequence[float], gamma: float) -> None:
        super().__init__()
        self.alpha = alpha
        self.register_buffer("beta", torch.tensor(beta, dtype=torch.float32), persistent=False)
        self.gamma = gamma

    def forward(
        self, outputs: HeadOutputs, targets: Targets, defaults: Tensor, pose_coder: PoseCoder
    ) -> LossTerms:
        """The loss of a batch. defaults: (A, 4) `cx, cy, w, h`.

        Everything is computed in float32, whatever precision the network ran in.
        """
        outputs = HeadOutputs(*(output.float() for output in outputs))
        assignment = self.assign(outputs, targets, defaults)
        matched = assignment.positive.sum().float()
        n = ranks.total(matched).clamp(min=1) / ranks.count()
        confidence = self.confidence_loss(outputs, assignment) / n
        box = self.box_loss(outputs, targets, assignment, defaults) / n
        pose = self.pose_loss(outputs, targets, assignment, pose_coder) / n
        loss = confidence + self.alpha * box + pose
        return LossTerms(loss, confidence, box, pose, matched)

    def assign(self, outputs: HeadOutputs, targets: Targets, defaults: Tensor) -> Assignment:
        """Match default boxes with the ground truth and mine hard negatives."""
        truth = match_boxes(targets.boxes, targets.valid, defaults)
        positive = truth >= 0
        negative = hard_negatives(outputs.class_logits, positive, NEGATIVE_RATIO)
        return Assignment(truth.clamp(min=0), positive, negative)

    def confidence_loss(self, outputs: HeadOutputs, assignment: Assignment) -> Tensor:
        """L_conf: softmax cross-entropy over matched boxes and hard negatives."""
        label = assignment.positive.long()
        losses = functional.cross_entropy(
            outputs.class_logits.transpose(1, 2), label, reduction="none"
        )
        return torch.where(assignment.positive | assignment.negative, losses, 0.0).sum()

    def box_loss(
        self, outputs: HeadOutputs, targets: Targets, assignment: Assignment, defaults: Tensor
    ) -> Tensor:
        """L_bbox: smooth L1 over matched boxes."""
        boxes = gather_truth(targets.boxes, assignment.truth)
        error = outputs.box_offsets - encode_boxes(boxes, defaults)
        return smooth_l1(torch.where(assignment.positive[..., None], error, 0.0)).sum()

    def pose_loss(
        self,
        outputs: HeadOutputs,
        targets: Targets,
        assignment: Assignment,
        pose_coder: PoseCoder,
    ) -> Tensor:
        """L_pose: the sum over p of beta_p L_1(gamma (pred_p - target_p)), L_1 being smooth L1.

        Summed over matched boxes of images with known poses. A class coder uses cross-entropy
        instead of L_1 (see `PoseCoder.errors`). The paper also mentions outputs "set to 0 if the
        instruments are not on that location"; docs/conventions.md explains why this is not part of
        the loss.
        """
        counts = (assignment.positive & targets.has_pose[:, None])[..., None]
        # An unknown pose may be NaN, and its gradient too, even if the loss masks it out.
        poses = torch.where(counts, gather_truth(targets.poses, assignment.truth), 0.0)
        errors = pose_coder.errors(outputs.poses, poses, self.gamma)
        return (self.beta * torch.where(counts, errors, 0.0)).sum()


def gather_truth(values: Tensor, truth: Tensor) -> Tensor:
    """The values (B, G, K) of each default box's ground truth, truth (B, A) -> (B, A, K)."""
    return values.gather(1, truth[..., None].expand(-1, -1, values.shape[2]))
