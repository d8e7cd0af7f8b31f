"""Poses as classes, as in SSD-6D (Kehl et al., 2017): one bin of each dimension is correct."""

import math
from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn import functional

from shaftpose.core.errors import InputError
from shaftpose.network.pose_network import wrap_yaw
from shaftpose.network.ssd.pose_coding import PoseCoder

_ROUNDING = 1e-6  # in steps: (0.3 - 0.0) / 0.1 may differ from 3


class BinCoder(PoseCoder):
    """One logit for each bin of each dimension; the bins of a dimension are `steps` wide.

    Bin k holds low + k step <= value < low + (k + 1) step and is decoded to its centre. Values
    beyond the outermost bins belong to them. The last bin has full width even if the range ends
    inside it: the last of yaw's 72 bins of 5 deg over 0..358 is 355..360.

    Yaw is measured around the circle from its lowest value, so 359 and -1 deg are in the same bin.
    The bins on either side of the seam are separate classes; cross-entropy treats no two bins as
    neighbours.

    bins: their number in each dimension; `values` is the sum. Raises InputError unless `steps` has
    one positive number for each dimension.
    """

    continuous = False
    low: Tensor
    steps: Tensor
    last: Tensor

    def __init__(self, low: Sequence[float], high: Sequence[float], steps: Sequence[float]) -> None:
        super().__init__()
        if len(steps) != len(low) or min(steps) <= 0:
            raise InputError(
                f"pose_coder.steps = {list(steps)}: must be {len(low)} numbers above 0, the "
                "bins' widths in x, y, z (mm), pitch and yaw (deg)"
            )
        self.bins = tuple(
            math.ceil((end - start) / step - _ROUNDING)
            for start, end, step in zip(low, high, steps, strict=True)
        )
        self.values = sum(self.bins)
        self.register_buffer("low", torch.tensor(low, dtype=torch.float32))
        self.register_buffer("steps", torch.tensor(list(steps), dtype=torch.float32))
        self.register_buffer("last", torch.tensor(self.bins) - 1, persistent=False)

    def encode(self, poses: Tensor) -> Tensor:
        """(..., 5) mm and deg -> (..., 5) int64, each dimension's bin."""
        above = poses - self.low
        above = torch.cat([above[..., :4], torch.remainder(above[..., 4:], 360.0)], dim=-1)
        bins = torch.floor(above / self.steps).long()
        return torch.minimum(bins.clamp(min=0), self.last)

    def decode(self, predicted: Tensor) -> Tensor:
        """(..., K) logits -> (..., 5) mm and deg: the centres of the most likely bins."""
        likeliest = [logits.argmax(dim=-1) for logits in self._by_dimension(predicted)]
        return wrap_yaw(self.low + (torch.stack(likeliest, dim=-1) + 0.5) * self.steps)

    def errors(self, predicted: Tensor, poses: Tensor, gamma: float) -> Tensor:
        """Softmax cross-entropy of each dimension, (..., 5). `gamma` is ignored."""
        dimensions = zip(self._by_dimension(predicted), self.encode(poses).unbind(-1), strict=True)
        return torch.stack([_cross_entropy(logits, bins) for logits, bins in dimensions], dim=-1)

    def _by_dimension(self, predicted: Tensor) -> tuple[Tensor, ...]:
        """(..., K) -> for each dimension (..., its number of bins)."""
        return predicted.split(self.bins, dim=-1)


def _cross_entropy(logits: Tensor, classes: Tensor) -> Tensor:
    """(..., classes) and (...) int64 -> (...)."""
    flat = functional.cross_entropy(logits.flatten(0, -2), classes.flatten(), reduction="none")
    return flat.view(classes.shape)
