"""From the head's outputs to instruments: candidates, non-maximum suppression, poses."""

from typing import NamedTuple

import torch
from torch import Tensor

from shaftpose.network.box_coding import decode_boxes
from shaftpose.network.heads import HeadOutputs
from shaftpose.network.inception_v4 import IMAGE_SIDE_PX
from shaftpose.network.nms import nms_mask
from shaftpose.network.pose_coding import PoseCoder


class DecodedOutputs(NamedTuple):
    """The instruments of a batch, best score first, padded with zeros.

    boxes: (B, keep, 4) `x0, y0, x1, y1` in pixels; scores: (B, keep); poses: (B, keep, 5) mm, deg.
    """

    boxes: Tensor
    scores: Tensor
    poses: Tensor


def decode(
    outputs: HeadOutputs,
    defaults: Tensor,
    pose_coder: PoseCoder,
    top_k: int = 250,
    iou_threshold: float = 0.5,
    keep: int = 20,
) -> DecodedOutputs:
    """The `top_k` most confident boxes, then non-maximum suppression, then the `keep` best.

    defaults: (A, 4) `cx, cy, w, h`. The pose is that of the surviving box.
    """
    confidence = outputs.class_logits.float().softmax(dim=-1)[..., 1]
    scores, chosen = confidence.topk(top_k, dim=1)
    offsets = gather_rows(outputs.box_offsets.float(), chosen)
    boxes = decode_boxes(offsets, defaults[chosen]).clamp(0.0, 1.0) * IMAGE_SIDE_PX
    survivors = scores * nms_mask(boxes, scores, iou_threshold)
    scores, kept = survivors.topk(keep, dim=1)
    found = (scores > 0)[..., None]
    poses = pose_coder.decode(gather_rows(gather_rows(outputs.poses.float(), chosen), kept))
    return DecodedOutputs(
        torch.where(found, gather_rows(boxes, kept), 0.0), scores, torch.where(found, poses, 0.0)
    )


def gather_rows(values: Tensor, rows: Tensor) -> Tensor:
    """values (B, A, K) at rows (B, N) int64 -> (B, N, K)."""
    return values.gather(1, rows[..., None].expand(-1, -1, values.shape[2]))
