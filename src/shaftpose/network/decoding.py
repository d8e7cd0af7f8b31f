"""Decoding of the head's outputs: candidates, non-maximum suppression, poses."""

import torch
from torch import Tensor

from shaftpose.network.nms import nms_mask
from shaftpose.network.pose_network import IMAGE_SIDE_PX, DecodedOutputs
from shaftpose.network.ssd.box_coding import decode_boxes
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


def gather_rows(values: Tensor, rows: Tensor) -> Tensor:
    """values (B, A, K) at rows (B, N) int64 -> (B, N, K)."""
    return values.gather(1, rows[..., None].expand(-1, -1, values.shape[2]))
