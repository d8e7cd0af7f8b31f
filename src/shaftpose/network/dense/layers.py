"""Layers of E's network and of its edge reader."""

from torch import Tensor, nn
from torch.nn import functional

Pair = tuple[int, int]


class Residual(nn.Module):
    """Two convolutions with batch normalisation, the first perhaps dilated, and a shortcut."""

    def __init__(self, channels: int, kernel: Pair = (3, 3), dilation: Pair = (1, 1)) -> None:
        super().__init__()
        self.first = conv_norm_relu(channels, channels, kernel, dilation=dilation)
        self.second = conv_norm_relu(channels, channels, kernel)[:-1]

    def forward(self, x: Tensor) -> Tensor:
        """(B, channels, h, w) -> the same shape."""
        return functional.relu(x + self.second(self.first(x)))


def conv_norm_relu(
    in_channels: int,
    channels: int,
    kernel: Pair = (3, 3),
    stride: Pair = (1, 1),
    dilation: Pair = (1, 1),
    padded: bool = True,
) -> nn.Sequential:
    """A convolution without bias, batch normalisation and ReLU.

    padded: keeps the size of the input, divided by the stride.
    """
    across, along = (d * (k // 2) * padded for k, d in zip(kernel, dilation, strict=True))
    return nn.Sequential(
        nn.Conv2d(in_channels, channels, kernel, stride, (across, along), dilation, bias=False),
        nn.BatchNorm2d(channels),
        nn.ReLU(inplace=True),
    )
