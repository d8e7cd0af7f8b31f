"""SSD's hard negative mining: selects the background boxes of the confidence loss."""

import torch
from torch import Tensor


def hard_negatives(class_logits: Tensor, positive: Tensor, ratio: int) -> Tensor:
    """(B, A) bool: per image, the `ratio` x positives background boxes with the highest
    instrument scores.

    class_logits: (B, A, 2); positive: (B, A) bool. An image without positives gives no negatives;
    one with too few background boxes gives all of them.
    """
    # The loss of a background box grows with the difference of its logits.
    difficulty = (class_logits[..., 1] - class_logits[..., 0]).detach()
    difficulty = difficulty.masked_fill(positive, -torch.inf)
    wanted = ratio * positive.sum(dim=1, keepdim=True)
    most = min(int(wanted.max()), difficulty.shape[1])
    hardest = difficulty.topk(most, dim=1).indices
    mined = torch.arange(most, device=wanted.device) < wanted
    return torch.zeros_like(positive).scatter_(1, hardest, mined) & ~positive
