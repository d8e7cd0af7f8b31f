"""Non-maximum suppression as a single operator, which an export replaces by ONNX's own."""

import torch
from torch import Tensor

from shaftpose.network.ssd.boxes import pairwise_iou


@torch.library.custom_op("shaftpose::nms_mask", mutates_args=())
def nms_mask(boxes: Tensor, scores: Tensor, iou_threshold: float) -> Tensor:
    """(B, K) float32: 1 for boxes that survive, 0 for the suppressed.

    boxes: (B, K, 4) `x0, y0, x1, y1`; scores: (B, K). Follows the greedy rule exactly: a box is
    suppressed if its IoU with a surviving box of a higher score exceeds `iou_threshold`.
    """
    order = scores.argsort(dim=1, descending=True, stable=True)
    ranked = boxes.gather(1, order[..., None].expand_as(boxes))
    rivals = (pairwise_iou(ranked, ranked) > iou_threshold).triu(diagonal=1)
    survives = torch.ones_like(order, dtype=torch.bool)
    # Each round settles at least the next box in rank, so the loop ends. Only its fixed point
    # obeys the rule.
    while True:
        updated = ~(rivals & survives[..., None]).any(dim=1)
        if torch.equal(updated, survives):
            break
        survives = updated
    return torch.zeros_like(scores, dtype=torch.float32).scatter(1, order, survives.float())


@nms_mask.register_fake
def _(boxes: Tensor, scores: Tensor, iou_threshold: float) -> Tensor:
    return torch.empty_like(scores, dtype=torch.float32)


OPERATOR = torch.ops.shaftpose.nms_mask.default
