"""Decoding of a head's outputs: candidates, non-maximum suppression, poses."""

import torch
from torch import Tensor

from shaftpose.network.pose_network import IMAGE_SIDE_PX, DecodedOutputs, gather_rows
from shaftpose.network.ssd.default_boxes import decode_boxes, pairwise_iou
from shaftpose.network.ssd.heads import HeadOutputs
from shaftpose.network.ssd.pose_coding import PoseCoder
from shaftpose.settings.schema import DetectionSettings


def decode(
    outputs: HeadOutputs, defaults: Tensor, pose_coder: PoseCoder, limits: DetectionSettings
) -> DecodedOutputs:
    """Select the `top_k` most confident boxes, apply non-maximum suppression, keep the best.

    defaults: (A, 4) `cx, cy, w, h`. Each surviving box keeps its own pose.
    """
    confidence = outputs.class_logits.float().softmax(dim=-1)[..., 1]
    scores, chosen = confidence.topk(limits.top_k, dim=1)
    offsets = gather_rows(outputs.box_offsets.float(), chosen)
    boxes = decode_boxes(offsets, defaults[chosen]).clamp(0.0, 1.0) * IMAGE_SIDE_PX
    survivors = scores * nms_mask(boxes, scores, limits.nms_iou)
    scores, kept = survivors.topk(limits.max_detections, dim=1)
    found = (scores > 0)[..., None]
    poses = pose_coder.decode(gather_rows(gather_rows(outputs.poses.float(), chosen), kept))
    return DecodedOutputs(
        torch.where(found, gather_rows(boxes, kept), 0.0), scores, torch.where(found, poses, 0.0)
    )


@torch.library.custom_op("shaftpose::nms_mask", mutates_args=())
def nms_mask(boxes: Tensor, scores: Tensor, iou_threshold: float) -> Tensor:
    """Non-maximum suppression, (B, K) float32: 1 for boxes that survive, 0 for the suppressed.

    A single operator, because the export replaces it by ONNX's own. Follows the greedy rule
    exactly: a box is suppressed if its IoU with a surviving box of a higher score exceeds
    `iou_threshold`. boxes: (B, K, 4) `x0, y0, x1, y1`; scores: (B, K).
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


NMS_OPERATOR = torch.ops.shaftpose.nms_mask.default
