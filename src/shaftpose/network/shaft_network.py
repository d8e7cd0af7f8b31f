"""The whole network: backbone, head, and what is needed to read the head's outputs."""

from collections.abc import Callable

import torch
from torch import Tensor, nn

from shaftpose.network.default_boxes import BOXES_PER_CELL, clipped, default_boxes
from shaftpose.network.heads import HeadOutputs
from shaftpose.network.inception_v4 import InceptionV4Features
from shaftpose.network.pose_coding import PoseCoder


class ShaftNetwork(nn.Module):
    """Finds shafts and their poses in one pass.

    `head` builds a head from `in_channels`, `boxes_per_cell`, `width` and `pose_values` (see
    `heads`), the last as `pose_coder` says; it also reads the head's poses.
    """

    defaults: Tensor

    def __init__(
        self,
        backbone: InceptionV4Features,
        head: Callable[..., nn.Module],
        pose_coder: PoseCoder,
    ) -> None:
        super().__init__()
        self.backbone = backbone
        self.head = head(
            in_channels=backbone.channels,
            boxes_per_cell=BOXES_PER_CELL,
            width=backbone.width,
            pose_values=pose_coder.values,
        )
        self.pose_coder = pose_coder
        defaults = clipped(default_boxes(backbone.cell_centres()))
        self.register_buffer("defaults", defaults, persistent=False)

    def forward(self, images: Tensor) -> HeadOutputs:
        """(B, 3, 299, 299) in [-1, 1] -> predictions for the A = 7322 default boxes."""
        return self.head(self.backbone(images))


def normalise_images(images: Tensor) -> Tensor:
    """(B, H, W, 3) uint8 RGB -> (B, 3, H, W) float in [-1, 1], channels last in memory."""
    pixels = images.permute(0, 3, 1, 2).float()
    return torch.add(-1.0, pixels, alpha=1 / 127.5)
