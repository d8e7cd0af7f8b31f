"""A camera without distortion, its optical axis at the centre of a square image, in torch."""

import math

import torch
from torch import Tensor

from shaftpose.core.geometry import Camera


class Pinhole:
    """Projects between mm and pixels; the paper's camera has 299 x 299 px and 95 deg."""

    def __init__(self, side_px: int, view_deg: float) -> None:
        self.side_px = side_px
        self.focal_px = side_px / (2 * math.tan(math.radians(view_deg) / 2))
        self.centre_px = side_px / 2

    @property
    def camera(self) -> Camera:
        """The same camera for NumPy."""
        centre = self.centre_px
        return Camera(self.side_px, self.side_px, self.focal_px, centre, centre)

    def project(self, points: Tensor) -> Tensor:
        """(..., 3) mm -> (..., 2) px, with pixel centres at + 0.5."""
        return self.focal_px * points[..., :2] / points[..., 2:] + self.centre_px

    def lift(self, pixels: Tensor, depth: Tensor) -> Tensor:
        """Pixels (..., 2) at a depth (..., 1) in mm -> (..., 3) mm."""
        return torch.cat([(pixels - self.centre_px) / self.focal_px * depth, depth], dim=-1)

    def cell_centres(self, cells: int, like: Tensor) -> Tensor:
        """(cells, cells, 2) px `x, y` of a grid over the image."""
        centres = (torch.arange(cells, device=like.device) + 0.5) * (self.side_px / cells)
        y, x = torch.meshgrid(centres, centres, indexing="ij")
        return torch.stack([x, y], dim=-1)
