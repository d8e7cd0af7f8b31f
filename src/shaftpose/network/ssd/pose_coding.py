"""Coding of poses in a head's outputs: the interface, and the paper's regression.

Heads, loss, decoding and export access poses only through a `PoseCoder`; a variant's file selects
it. `pose_bins` holds the other implementation.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

from shaftpose.network.pose_network import wrap_yaw


class PoseCoder(nn.Module, ABC):
    """The coding of poses in K numbers per default box.

    Built from the ranges of poses, `low` and `high` (5 values each: x_mm, y_mm, z_mm, pitch_deg,
    yaw_deg). The values that decoding needs are buffers, so that a checkpoint stores them: its
    weights mean nothing without them.

    values: K, the numbers that a head predicts for each default box; continuous: whether a small
    change of the outputs is a small change of the pose.
    """

    values: int
    continuous: bool

    @abstractmethod
    def decode(self, predicted: Tensor) -> Tensor:
        """(..., K) -> (..., 5) mm and deg, yaw in [0, 360)."""

    @abstractmethod
    def errors(self, predicted: Tensor, poses: Tensor, gamma: float) -> Tensor:
        """The error of each dimension, as in L_pose before the weighting by beta.

        predicted: (..., K); poses: (..., 5) mm and deg, the ground truth -> (..., 5). `gamma`
        scales numeric differences; a coding without them ignores it.
        """


class RegressionCoder(PoseCoder):
    """One number for each dimension, its range scaled to [-1, 1] (paper, III-C)."""

    continuous = True
    low: Tensor
    high: Tensor

    def __init__(self, low: Sequence[float], high: Sequence[float]) -> None:
        super().__init__()
        self.values = len(low)
        self.register_buffer("low", torch.tensor(low, dtype=torch.float32))
        self.register_buffer("high", torch.tensor(high, dtype=torch.float32))

    def encode(self, poses: Tensor) -> Tensor:
        """(..., 5) mm and deg -> (..., 5), in [-1, 1] within the ranges."""
        return 2 * (poses - self.low) / (self.high - self.low) - 1

    def decode(self, predicted: Tensor) -> Tensor:
        """(..., 5) codes -> (..., 5) mm and deg, yaw in [0, 360)."""
        return wrap_yaw(self.low + (predicted + 1) / 2 * (self.high - self.low))

    def errors(self, predicted: Tensor, poses: Tensor, gamma: float) -> Tensor:
        """smoothL1(gamma (predicted - target)) of each dimension, (..., 5) (paper, III-E)."""
        return smooth_l1(gamma * (predicted - self.encode(poses)))


def smooth_l1(error: Tensor) -> Tensor:
    """0.5 e^2 where |e| < 1, else |e| - 0.5; any shape."""
    return functional.smooth_l1_loss(error, torch.zeros_like(error), reduction="none")
