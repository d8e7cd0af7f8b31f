"""Positions of a feature map's cells in the image, from the strides and paddings of its layers.

A cell's receptive field is a square of the image. Each layer moves its centre by
`(kernel - 1) / 2 - padding` cells of the layer before (Dumoulin and Visin, 2016, relationship 6);
clipping at the border is ignored. All other layers, and functions called without a module, must
keep the cells' positions.
"""

from dataclasses import dataclass
from typing import Any

from torch import nn


@dataclass(frozen=True)
class Grid:
    """Centres of cells: the first one, and the step to the next, in pixels, equal in x and y.

    The default is the grid of the image's pixels.
    """

    first_px: float = 0.5
    step_px: float = 1.0

    def centre_px(self, cell: int) -> float:
        """The centre of the cell in this row or column."""
        return self.first_px + cell * self.step_px


def through(module: nn.Module, grid: Grid) -> Grid:
    """The output grid of a module whose input has `grid`.

    Modules in a `branches` list are parallel, all others sequential.
    """
    if isinstance(module, nn.Conv2d | nn.MaxPool2d | nn.AvgPool2d):
        kernel, stride, padding = (
            _pair(size) for size in (module.kernel_size, module.stride, module.padding)
        )
        (shift,) = {(k - 1) / 2 - p for k, p in zip(kernel, padding, strict=True)}
        (factor,) = set(stride)
        return Grid(grid.first_px + shift * grid.step_px, grid.step_px * factor)
    branches = getattr(module, "branches", None)
    if branches is not None:
        (behind,) = {through(branch, grid) for branch in branches}
        return behind
    for child in module.children():
        grid = through(child, grid)
    return grid


def _pair(size: Any) -> tuple[int, int]:
    """A layer's size as a pair; torch stores one number, or one for each axis."""
    return size if isinstance(size, tuple) else (size, size)
