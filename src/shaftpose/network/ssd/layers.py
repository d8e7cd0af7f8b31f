"""Layers shared by backbone and heads: Conv-BN-ReLU and its statistics."""

import torch
from torch import Tensor, nn

Size = int | tuple[int, int]


class ConvBNReLU(nn.Module):
    """A convolution without bias, batch normalisation (eps 1e-3) and ReLU."""

    def __init__(
        self, in_channels: int, channels: int, kernel: Size, stride: int = 1, padding: Size = 0
    ) -> None:
        super().__init__()
        self.conv = nn.Conv2d(in_channels, channels, kernel, stride, padding, bias=False)
        self.norm = nn.BatchNorm2d(channels, eps=1e-3)
        self.activation = nn.ReLU(inplace=True)
        self.channels = channels

    def forward(self, x: Tensor) -> Tensor:
        """(B, in_channels, h, w) -> (B, channels, h', w')."""
        result: Tensor = self.activation(self.norm(self.conv(x)))
        if self.training and result.requires_grad:
            # Concatenation returns slices of its gradient, which slow ReLU's backward on a CPU.
            result.register_hook(_packed)
        return result


def freeze_statistics(network: nn.Module) -> None:
    """Make batch normalisation use its running statistics without updating them."""
    for module in network.modules():
        if isinstance(module, nn.modules.batchnorm._BatchNorm):  # includes SyncBatchNorm
            module.eval()


def _packed(gradient: Tensor) -> Tensor:
    return gradient.contiguous(memory_format=torch.channels_last)
