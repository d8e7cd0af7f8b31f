"""Poses in mm and degrees as the network sees them: each dimension's range becomes [-1, 1]."""

from collections.abc import Sequence

import torch
from torch import Tensor, nn


class PoseCoder(nn.Module):
    """Scales poses to [-1, 1] and back.

    `low` and `high` (5 values each: x_mm, y_mm, z_mm, pitch_deg, yaw_deg) are buffers: they travel
    with a checkpoint, because its weights mean nothing without them.
    """

    low: Tensor
    high: Tensor

    def __init__(self, low: Sequence[float], high: Sequence[float]) -> None:
        super().__init__()
        self.register_buffer("low", torch.tensor(low, dtype=torch.float32))
        self.register_buffer("high", torch.tensor(high, dtype=torch.float32))

    def encode(self, poses: Tensor) -> Tensor:
        """(..., 5) mm and deg -> (..., 5), in [-1, 1] within the ranges."""
        return 2 * (poses - self.low) / (self.high - self.low) - 1

    def decode(self, codes: Tensor) -> Tensor:
        """(..., 5) codes -> (..., 5) mm and deg, yaw in [0, 360)."""
        poses = self.low + (codes + 1) / 2 * (self.high - self.low)
        return torch.cat([poses[..., :4], _wrap_deg(poses[..., 4:])], dim=-1)


def _wrap_deg(angle: Tensor) -> Tensor:
    wrapped = torch.remainder(angle, 360.0)
    # The remainder of a tiny negative angle is rounded to 360 itself.
    return torch.where(wrapped >= 360.0, 0.0, wrapped)
