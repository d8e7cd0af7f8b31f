"""The smooth L1 function of the box and pose losses."""

import torch
from torch import Tensor
from torch.nn import functional


def smooth_l1(error: Tensor) -> Tensor:
    """0.5 e^2 where |e| < 1, else |e| - 0.5; any shape."""
    return functional.smooth_l1_loss(error, torch.zeros_like(error), reduction="none")
