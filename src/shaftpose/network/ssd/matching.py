"""SSD's matching of default boxes to ground truth boxes."""

import torch
from torch import Tensor

from shaftpose.network.ssd.boxes import pairwise_iou, to_corners

IOU_THRESHOLD = 0.5  # as in SSD


def match_boxes(boxes: Tensor, valid: Tensor, defaults: Tensor) -> Tensor:
    """The ground truth of every default box, (B, A) int64, -1 for background.

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
