"""Prediction heads: six feature maps in, class, box and pose of every default box out.

A head is a module built from `(in_channels, boxes_per_cell, width, pose_values)`: the channels of
each map, the default boxes in each of its cells, the network's width, and how many numbers code the
pose of one box (see `PoseCoder`). It returns `HeadOutputs`.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import torch
from torch import Tensor, nn

from shaftpose.network.ssd.layers import ConvBNReLU, scale_channels

CLASSES = 2  # background, instrument
BOX_OFFSETS = 4


class HeadOutputs(NamedTuple):
    """The raw predictions for each of A default boxes.

    class_logits: (B, A, 2), background then instrument; box_offsets: (B, A, 4) in SSD's coding;
    poses: (B, A, pose_values), as the network's `PoseCoder` codes them.
    """

    class_logits: Tensor
    box_offsets: Tensor
    poses: Tensor


class ArchitectureC(nn.Module):
    """The paper's naive regression: class, box and pose in parallel on each map.

    Each has one 3 x 3 convolution, as in SSD, so `width` has no effect. With one pose value for
    each bin of `BinCoder` instead of five, it is SSD-6D's head (Kehl et al., 2017), Architecture B.
    """

    def __init__(
        self,
        in_channels: Sequence[int],
        boxes_per_cell: Sequence[int],
        width: float,
        pose_values: int,
    ) -> None:
        super().__init__()
        self.pose_values = pose_values
        self.class_convs = prediction_convs(in_channels, boxes_per_cell, CLASSES)
        self.box_convs = prediction_convs(in_channels, boxes_per_cell, BOX_OFFSETS)
        self.pose_convs = prediction_convs(in_channels, boxes_per_cell, pose_values)

    def forward(self, features: Sequence[Tensor]) -> HeadOutputs:
        """Six maps (B, in_channels[i], h_i, w_i) -> predictions for A default boxes."""
        return HeadOutputs(
            flatten_maps(apply_each(self.class_convs, features), CLASSES),
            flatten_maps(apply_each(self.box_convs, features), BOX_OFFSETS),
            flatten_maps(apply_each(self.pose_convs, features), self.pose_values),
        )


class ArchitectureD(nn.Module):
    """The paper's proposal: the class and box predictions feed the pose path."""

    def __init__(
        self,
        in_channels: Sequence[int],
        boxes_per_cell: Sequence[int],
        width: float,
        pose_values: int,
    ) -> None:
        super().__init__()
        self.pose_values = pose_values
        self.class_convs = prediction_convs(in_channels, boxes_per_cell, CLASSES)
        self.box_convs = prediction_convs(in_channels, boxes_per_cell, BOX_OFFSETS)
        self.pose_paths = nn.ModuleList(
            ConditionedPosePath(channels, boxes, width, pose_values)
            for channels, boxes in zip(in_channels, boxes_per_cell, strict=True)
        )

    def forward(self, features: Sequence[Tensor]) -> HeadOutputs:
        """Six maps (B, in_channels[i], h_i, w_i) -> predictions for A default boxes."""
        class_maps = apply_each(self.class_convs, features)
        box_maps = apply_each(self.box_convs, features)
        pose_maps = apply_each(self.pose_paths, features, class_maps, box_maps)
        return HeadOutputs(
            flatten_maps(class_maps, CLASSES),
            flatten_maps(box_maps, BOX_OFFSETS),
            flatten_maps(pose_maps, self.pose_values),
        )


class ConditionedPosePath(nn.Module):
    """Architecture D's pose path on one map with N default boxes per cell."""

    def __init__(self, in_channels: int, boxes: int, width: float, pose_values: int) -> None:
        super().__init__()
        wide = scale_channels(256, width)
        narrow = max(16, scale_channels(64, width))
        self.from_feature = ConvBNReLU(in_channels, wide, 3, padding=1)
        self.from_detection = ConvBNReLU(boxes * (CLASSES + BOX_OFFSETS), narrow, 1)
        self.merge = ConvBNReLU(wide + narrow, wide, 3, padding=1)
        self.predict = nn.Conv2d(wide, boxes * pose_values, 3, padding=1)

    def forward(self, feature: Tensor, class_map: Tensor, box_map: Tensor) -> Tensor:
        """(B, in_channels, h, w), (B, 2 N, h, w) and (B, 4 N, h, w) -> (B, pose_values N, h, w)."""
        detection = self.from_detection(torch.cat([class_map, box_map], dim=1))
        return self.predict(self.merge(torch.cat([self.from_feature(feature), detection], dim=1)))


def prediction_convs(
    in_channels: Sequence[int], boxes_per_cell: Sequence[int], values: int
) -> nn.ModuleList:
    """One 3 x 3 convolution per map that predicts `values` numbers for each default box."""
    return nn.ModuleList(
        nn.Conv2d(channels, boxes * values, 3, padding=1)
        for channels, boxes in zip(in_channels, boxes_per_cell, strict=True)
    )


def apply_each(modules: Iterable[nn.Module], *inputs: Sequence[Tensor]) -> list[Tensor]:
    """Apply the i-th module to the i-th tensor of every input."""
    return [module(*args) for module, *args in zip(modules, *inputs, strict=True)]


def flatten_maps(maps: Sequence[Tensor], values: int) -> Tensor:
    """Maps (B, N_i * values, h_i, w_i) -> (B, A, values), in the order of the default boxes."""
    rows = [m.permute(0, 2, 3, 1).reshape(m.shape[0], -1, values) for m in maps]
    return torch.cat(rows, dim=1)
