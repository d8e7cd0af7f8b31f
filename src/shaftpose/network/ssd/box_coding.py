"""SSD's coding of a box relative to its default box, with variances 0.1 and 0.2."""

import torch
from torch import Tensor

from shaftpose.network.ssd.boxes import to_centre, to_corners

CENTRE_VARIANCE = 0.1
SIZE_VARIANCE = 0.2


def encode_boxes(boxes: Tensor, defaults: Tensor) -> Tensor:
    """Boxes (..., A, 4) `x0, y0, x1, y1` and defaults (A, 4) `cx, cy, w, h` -> (..., A, 4)."""
    boxes = to_centre(boxes)
    centre = (boxes[..., :2] - defaults[..., :2]) / defaults[..., 2:] / CENTRE_VARIANCE
    size = torch.log(boxes[..., 2:] / defaults[..., 2:]) / SIZE_VARIANCE
    return torch.cat([centre, size], dim=-1)


def decode_boxes(offsets: Tensor, defaults: Tensor) -> Tensor:
    """Offsets (..., A, 4) and defaults `cx, cy, w, h` -> (..., A, 4) `x0, y0, x1, y1`."""
    centre = defaults[..., :2] + offsets[..., :2] * CENTRE_VARIANCE * defaults[..., 2:]
    size = defaults[..., 2:] * torch.exp(offsets[..., 2:] * SIZE_VARIANCE)
    return to_corners(torch.cat([centre, size], dim=-1))
