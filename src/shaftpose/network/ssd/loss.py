"""The paper's loss (III-E): L = (L_conf + alpha L_bbox + L_pose) / n.

n is the number of matched default boxes in the batch, at least 1. `match_boxes` selects them,
`hard_negatives` selects the background boxes that count. `encode_boxes` and the network's
`PoseCoder` define how the outputs code boxes and poses.

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
from shaftpose.network.pose_network import gather_rows, rank_count, sum_over_ranks
from shaftpose.network.ssd.default_boxes import encode_boxes, pairwise_iou, to_corners
from shaftpose.network.ssd.heads import HeadOutputs
from shaftpose.network.ssd.pose_coding import PoseCoder, smooth_l1

# As in SSD: least IoU of a match; mined background boxes per matched box.
IOU_THRESHOLD, NEGATIVE_RATIO = 0.5, 3


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

        Computes in float32, even if the network ran in half precision.
        """
        outputs = HeadOutputs(*(output.float() for output in outputs))
        assignment = self.assign(outputs, targets, defaults)
        matched = assignment.positive.sum().float()
        n = sum_over_ranks(matched).clamp(min=1) / rank_count()
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
        boxes = gather_rows(targets.boxes, assignment.truth)
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
        poses = torch.where(counts, gather_rows(targets.poses, assignment.truth), 0.0)
        errors = pose_coder.errors(outputs.poses, poses, self.gamma)
        return (self.beta * torch.where(counts, errors, 0.0)).sum()


def match_boxes(boxes: Tensor, valid: Tensor, defaults: Tensor) -> Tensor:
    """SSD's matching: the ground truth of every default box, (B, A) int64, -1 for background.

    boxes: (B, G, 4) `x0, y0, x1, y1`, G > 0; valid: (B, G) bool; defaults: (A, 4) `cx, cy, w, h`.
    A default box matches the ground truth of the highest IoU, if that is at least `IOU_THRESHOLD`.
    In addition, each valid ground truth gets the default box of the highest IoU, however small; if
    two ground truths share their best default box, the later one gets it.
    """
    iou = pairwise_iou(boxes, to_corners(defaults)).masked_fill(~valid[..., None], -1.0)
    best_iou, best_truth = iou.max(dim=1)
    by_overlap = torch.where(best_iou >= IOU_THRESHOLD, best_truth, -1)
    forced = _force_matches(iou, valid)
    return torch.where(forced >= 0, forced, by_overlap)


def _force_matches(iou: Tensor, valid: Tensor) -> Tensor:
    """(B, A) int64: the last valid ground truth whose best default box this is, else -1."""
    batch, truths, defaults = iou.shape
    best_default = iou.argmax(dim=2)
    truth = torch.arange(truths, device=iou.device).expand(batch, truths)
    unmatched = torch.full((batch, defaults), -1, device=iou.device)
    # Unlike plain scatter, the maximum of the indices is deterministic.
    return unmatched.scatter_reduce(1, best_default, truth.where(valid, -1), reduce="amax")


def hard_negatives(class_logits: Tensor, positive: Tensor, ratio: int) -> Tensor:
    """SSD's hard negative mining: the background boxes of the confidence loss, (B, A) bool.

    These are, per image, `ratio` times as many as positives, with the highest instrument scores.
    class_logits: (B, A, 2); positive: (B, A) bool. An image without positives gives no negatives;
    one with too few background boxes gives all of them.
    """
    # The loss of a background box grows with the difference of its logits.
    difficulty = (class_logits[..., 1] - class_logits[..., 0]).detach()
    difficulty = difficulty.masked_fill(positive, -torch.inf)
    wanted = ratio * positive.sum(dim=1, keepdim=True)
    most = min(int(wanted.max()), difficulty.shape[1])
    hardest = difficulty.topk(most, dim=1).indices
    mined = torch.arange(most, device=wanted.device) < wanted
    return torch.zeros_like(positive).scatter_(1, hardest, mined) & ~positive
