"""Layers of backbone and heads, scaled by a width, and where the cells of their maps look."""

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn

from shaftpose.network.gradients import with_packed_gradient

Size = int | tuple[int, int]


def scale_channels(channels: int, width: float) -> int:
    """`channels` x `width`, rounded to a multiple of 4, at least 4; unchanged at width 1.0."""
    if width == 1.0:
        return channels
    return max(4, 4 * round(channels * width / 4))


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
        return with_packed_gradient(result) if self.training else result


@dataclass(frozen=True)
class Conv:
    """One row of the layer table; `padding` None keeps the map's size."""

    channels: int
    kernel: Size
    stride: int = 1
    padding: Size | None = None


class Chain(nn.Sequential):
    """A sequence of convolutions, each `Conv` scaled by `width`; has `channels` output channels."""

    def __init__(self, in_channels: int, width: float, *rows: Conv) -> None:
        super().__init__()
        self.channels = in_channels
        for row in rows:
            padding = _same_padding(row.kernel) if row.padding is None else row.padding
            scaled = scale_channels(row.channels, width)
            self.append(ConvBNReLU(self.channels, scaled, row.kernel, row.stride, padding))
            self.channels = scaled


class Pool(nn.Module):
    """A pooling layer with the attribute `channels`, like the other blocks."""

    def __init__(self, pool: nn.Module, channels: int) -> None:
        super().__init__()
        self.pool = pool
        self.channels = channels

    def forward(self, x: Tensor) -> Tensor:
        """(B, channels, h, w) -> (B, channels, h', w')."""
        return self.pool(x)


class PooledChain(Chain):
    """A 3 x 3 average pooling that keeps the map's size, then convolutions."""

    def forward(self, x: Tensor) -> Tensor:
        """(B, in_channels, h, w) -> (B, channels, h, w)."""
        average = nn.functional.avg_pool2d(x, 3, 1, 1, count_include_pad=False)
        return super().forward(average)


class Fork(nn.Module):
    """A chain that forks into several chains of one convolution each, concatenated."""

    def __init__(self, trunk: Chain, width: float, *rows: Conv) -> None:
        super().__init__()
        self.trunk = trunk
        self.tips = Concat(*(Chain(trunk.channels, width, row) for row in rows))
        self.channels: int = self.tips.channels

    def forward(self, x: Tensor) -> Tensor:
        """(B, in_channels, h, w) -> (B, channels, h, w)."""
        return self.tips(self.trunk(x))


class Concat(nn.Module):
    """Parallel branches on one input, concatenated over the channels."""

    def __init__(self, *branches: Chain | Pool | Fork) -> None:
        super().__init__()
        self.branches = nn.ModuleList(branches)
        self.channels: int = sum(branch.channels for branch in branches)

    def forward(self, x: Tensor) -> Tensor:
        """(B, in_channels, h, w) -> (B, channels, h', w')."""
        return torch.cat([branch(x) for branch in self.branches], dim=1)


def _same_padding(kernel: Size) -> Size:
    if isinstance(kernel, int):
        return kernel // 2
    return kernel[0] // 2, kernel[1] // 2


@dataclass(frozen=True)
class CellCentres:
    """Centres of the cells of a map along either axis: the first one, and the step to the next.

    By default those of the image's pixels.
    """

    first_px: float = 0.5
    step_px: float = 1.0

    def centre_px(self, cell: int) -> float:
        """The centre of the cell in this row or column."""
        return self.first_px + cell * self.step_px


def through(module: nn.Module, cells: CellCentres) -> CellCentres:
    """The cells of a module's output, if those of its input are `cells`.

    A cell's receptive field is a square of the image. Each convolution or pooling moves its centre
    by `(kernel - 1) / 2 - padding` cells of its input (Dumoulin and Visin, 2016, relationship 6);
    clipping at the border is ignored. Modules in a `branches` list are parallel, others sequential.
    Other layers, and functions called without a module, must keep the cells' positions.
    """
    if isinstance(module, nn.Conv2d | nn.MaxPool2d | nn.AvgPool2d):
        kernel, stride, padding = (
            _pair(size) for size in (module.kernel_size, module.stride, module.padding)
        )
        (shift,) = {(k - 1) / 2 - p for k, p in zip(kernel, padding, strict=True)}
        (factor,) = set(stride)
        return CellCentres(cells.first_px + shift * cells.step_px, cells.step_px * factor)
    branches = getattr(module, "branches", None)
    if branches is not None:
        (behind,) = {through(branch, cells) for branch in branches}
        return behind
    for child in module.children():
        cells = through(child, cells)
    return cells


def _pair(size: Any) -> tuple[int, int]:
    """A layer's size as a pair; torch stores one number, or one for each axis."""
    return size if isinstance(size, tuple) else (size, size)
