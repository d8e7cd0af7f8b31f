"""Boxes as `cx, cy, w, h` and as `x0, y0, x1, y1`, and their overlap."""

import torch
from torch import Tensor


def to_corners(boxes: Tensor) -> Tensor:
    """(..., 4) `cx, cy, w, h` -> (..., 4) `x0, y0, x1, y1`."""
    centre, size = boxes[..., :2], boxes[..., 2:]
    return torch.cat([centre - size / 2, centre + size / 2], dim=-1)


def to_centre(boxes: Tensor) -> Tensor:
    """(..., 4) `x0, y0, x1, y1` -> (..., 4) `cx, cy, w, h`."""
    low, high = boxes[..., :2], boxes[..., 2:]
    return torch.cat([(low + high) / 2, high - low], dim=-1)


def pairwise_iou(first: Tensor, second: Tensor) -> Tensor:
    """(..., N, 4) and (..., M, 4) `x0, y0, x1, y1` -> (..., N, M); 0 where both are empty."""
    a, b = first[..., :, None, :], second[..., None, :, :]
    low = torch.maximum(a[..., :2], b[..., :2])
    high = torch.minimum(a[..., 2:], b[..., 2:])
    shared = (high - low).clamp(min=0).prod(dim=-1)
    union = _area(a) + _area(b) - shared
    return shared / union.clamp(min=torch.finfo(union.dtype).tiny)


def _area(boxes: Tensor) -> Tensor:
    return (boxes[..., 2:] - boxes[..., :2]).prod(dim=-1)
