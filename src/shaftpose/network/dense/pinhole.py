"""A camera without distortion, its optical axis at the centre of a square image, in torch."""

import torch
from torch import Tensor

from shaftpose.core.geometry import Camera


class Pinhole:
    """Projects between mm and pixels; the paper's camera has 299 x 299 px and 95 deg."""

    def __init__(self, side_px: int, view_deg: float) -> None:
        self.side_px = side_px
        self.camera = Camera.from_field_of_view(side_px, side_px, view_deg)  # the same, for NumPy
        self.focal_px, self.centre_px = self.camera.focal_px, self.camera.cx

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
