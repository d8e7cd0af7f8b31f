"""E's loss: mask, tips and poses, with their targets for each cell of the maps."""

from typing import NamedTuple

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import ConfigDict
from pydantic.dataclasses import dataclass
from torch import Tensor
from torch.nn import functional

from shaftpose.core.instruments import OUTSIDE, TOOL_OR_SHAFT, UNKNOWN
from shaftpose.dataset.batches import Targets
from shaftpose.network.dense.coding import (
    OFFSET_SCALE_PX,
    Grid,
    axis_vectors,
    encoded_axis,
    encoded_depth,
    reference_points,
)
from shaftpose.network.pose_network import gather_rows
from shaftpose.settings.schema import Positive

_BORDER_REACH_PX = 8  # beyond which a border's weight is left out
_HEAT_PX = 6.0  # standard deviation of a tip's heat
_NEAR_CELLS = 5  # window around cells of which nothing is known that may hold a tip


@dataclass(frozen=True, config=ConfigDict(extra="forbid", allow_inf_nan=False))
class DenseLoss:
    """The loss of a batch. conf/variant/e.yaml explains the weights."""

    mask: Positive
    border: Positive
    border_px: Positive
    tip_cells: Positive
    smooth: Positive

    def __call__(
        self, mask: Tensor, maps: Tensor, targets: Targets, grid: Grid
    ) -> dict[str, Tensor]:
        """`loss` = `mask` + `tool` + `tip` + `pose`, scalars in float32.

        mask: (B, 2, h, w) logits of shafts and of all instruments; maps: (B, 7, h, w) in the cells
        of `grid`.
        """
        truth = dense_targets(targets, grid)
        assert targets.instances is not None
        shafts, tools = mask.float().split(1, dim=1)
        terms = {
            "mask": self.mask_loss(shafts, *shaft_masks(targets.instances)),
            "tool": self.mask_loss(tools, *tool_masks(targets.instances)),
            "tip": self.tip_loss(maps[:, 0].float().sigmoid(), truth.heat, truth.heat_known),
            "pose": self.pose_loss(maps[:, 1:].float(), truth.values, truth.counts),
        }
        return {"loss": torch.stack(list(terms.values())).sum(), **terms}

    def mask_loss(self, logits: Tensor, inside: Tensor, known: Tensor) -> Tensor:
        """Border-weighted cross-entropy plus Dice loss, at the image's resolution.

        Upsampling before the loss lets a half-resolution mask learn subpixel edges.
        inside, known: (B, H, W) bool; pixels that are not known do not count.
        """
        truth = (inside & known).float()
        logits = functional.interpolate(logits, size=truth.shape[-2:], mode="bilinear")[:, 0]
        weight = self.border_weight(truth) * known
        entropy = functional.binary_cross_entropy_with_logits(logits, truth, reduction="none")
        share = logits.sigmoid() * known
        dice = 1 - (2 * (share * truth).sum() + 1) / (share.sum() + truth.sum() + 1)
        return self.mask * (weight * entropy).sum() / weight.sum().clamp(min=1) + dice

    def border_weight(self, truth: Tensor) -> Tensor:
        """1 + border exp(-d / border_px), d being the Chebyshev distance to the mask's border.

        truth: (B, H, W) 0 or 1.
        """
        masks = truth.cpu().numpy().astype(np.uint8)
        weights = np.stack([self._border_weight(mask) for mask in masks])
        return torch.from_numpy(weights).to(truth.device)

    def _border_weight(self, mask: NDArray[np.uint8]) -> NDArray[np.float32]:
        """As `border_weight`, of one mask (H, W). OpenCV is ten times as fast as poolings."""
        border = cv2.morphologyEx(mask, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8))
        distance = cv2.distanceTransform(1 - border, cv2.DIST_C, 3)
        closeness = np.exp(-distance / self.border_px) * (distance <= _BORDER_REACH_PX)
        return np.asarray(1 + self.border * closeness, np.float32)

    def tip_loss(self, heat: Tensor, truth: Tensor, known: Tensor) -> Tensor:
        """The focal loss of the tip heat maps (CornerNet), per image and tip cell.

        known: (B, h, w), cells that count.
        """
        hit = (1 - heat).square() * truth * (heat + 1e-6).log() * (truth > 0.5)
        miss = (1 - truth).pow(4) * heat.square() * (1 - heat + 1e-6).log()
        images = known.flatten(1).any(1).sum().clamp(min=1)
        return -((hit + miss) * known).sum() / (self.tip_cells * images)

    def pose_loss(self, values: Tensor, truth: Tensor, counts: Tensor) -> Tensor:
        """Smooth L1 of tip offset, depth and axis where they are known, per cell on a shaft."""
        errors = functional.smooth_l1_loss(values, truth, reduction="none", beta=self.smooth)
        cells = counts.any(1).sum().clamp(min=1)
        return (errors * counts).sum(1).sum() / cells


def shaft_masks(instances: Tensor) -> tuple[Tensor, Tensor]:
    """Pixels of shafts, and pixels of which this is known, (B, H, W) bool each."""
    unknown = (instances == UNKNOWN) | (instances == TOOL_OR_SHAFT)
    return (instances > 0) & (instances < OUTSIDE), ~unknown


def tool_masks(instances: Tensor) -> tuple[Tensor, Tensor]:
    """Pixels of any part of an instrument, and pixels of which this is known, (B, H, W) bool."""
    return (instances > 0) & (instances != OUTSIDE), instances != UNKNOWN


class DenseTargets(NamedTuple):
    """Targets of E's maps, cell by cell.

    heat: (B, h, w) in [0, 1]; heat_known: the same shape, bool; values: (B, 6, h, w), see `coding`;
    counts: the same shape, bool, where they are known.
    """

    heat: Tensor
    heat_known: Tensor
    values: Tensor
    counts: Tensor


def dense_targets(targets: Targets, grid: Grid) -> DenseTargets:
    """The targets of a batch in the cells (h, w) of a grid.

    Images without poses have heat and offsets where tips are known. Tips outside the visible field
    have no heat, but offsets point to them.
    """
    assert targets.instances is not None, "this network needs instance masks for training"
    centres = grid.cells
    has_pose = targets.valid & targets.has_pose[:, None]
    tips_mm, axes = _reference_poses(targets, has_pose, grid)
    tips, has_tip = _tips(targets, tips_mm, has_pose, grid)
    rows = torch.cat([tips, encoded_depth(tips_mm[..., 2:]), encoded_axis(axes)], dim=-1)
    known = torch.cat(
        [has_tip[..., None].expand(-1, -1, 2), has_pose[..., None].expand(-1, -1, 4)], dim=-1
    )
    number = _coarse(targets.instances, grid)
    on_shaft = (number > 0) & (number <= rows.shape[1])
    shaft = torch.where(on_shaft, number - 1, 0).flatten(1)
    values, counts = (gather_rows(r, shaft).unflatten(1, centres.shape[:2]) for r in (rows, known))
    offsets = (values[..., :2] - centres) / OFFSET_SCALE_PX
    values = torch.cat([offsets, values[..., 2:]], dim=-1)
    counts = (counts & on_shaft[..., None]).permute(0, 3, 1, 2)
    unknown = (on_shaft & ~counts[:, 0]) | (number == UNKNOWN) | (number == TOOL_OR_SHAFT)
    return DenseTargets(
        heat=_heat(tips, has_tip & _in_view(tips, targets.instances), centres),
        heat_known=~_near(unknown),
        values=values.permute(0, 3, 1, 2),
        counts=counts,
    )


def _reference_poses(targets: Targets, has_pose: Tensor, grid: Grid) -> tuple[Tensor, Tensor]:
    """Tips (B, G, 3) mm and unit vectors (B, G, 3) towards the handles, for the grid's camera."""
    assert targets.cameras is not None
    poses = torch.where(has_pose[..., None], targets.poses, torch.ones_like(targets.poses))
    tips = reference_points(poses[..., :3], targets.cameras, grid)
    axes = reference_points(axis_vectors(poses), targets.cameras, grid)
    return tips, axes / axes.norm(dim=-1, keepdim=True)


def _tips(targets: Targets, tips_mm: Tensor, has_pose: Tensor, grid: Grid) -> tuple[Tensor, Tensor]:
    """Tips (B, G, 2) px, from poses where there are any, and whether they are known (B, G)."""
    tips = grid.project(tips_mm)
    if targets.tips_px is None:
        return tips, has_pose
    annotated = targets.valid & ~has_pose & targets.tips_px.isfinite().all(-1)
    return torch.where(annotated[..., None], targets.tips_px, tips), has_pose | annotated


def _in_view(tips: Tensor, instances: Tensor) -> Tensor:
    """Whether tips (B, G, 2) px lie in the visible field of the images, (B, G)."""
    height, width = instances.shape[1:]
    x, y = tips.floor().long().unbind(-1)
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    cell = y.clamp(0, height - 1) * width + x.clamp(0, width - 1)
    return inside & (instances.flatten(1).gather(1, cell) != OUTSIDE)


def _near(cells: Tensor) -> Tensor:
    """Whether one of the cells (B, h, w) bool is in a window around a cell."""
    window = functional.max_pool2d(cells.float()[:, None], _NEAR_CELLS, 1, _NEAR_CELLS // 2)
    return window[:, 0] > 0


def _heat(tips: Tensor, shown: Tensor, centres: Tensor) -> Tensor:
    """The largest of the Gaussians around the shown tips of (B, G, 2) px, (B, h, w)."""
    distance = (centres[None, None] - tips[:, :, None, None]).square().sum(-1)
    heat = torch.exp(-distance / (2 * _HEAT_PX**2)) * shown[..., None, None]
    return heat.amax(1)


def _coarse(instances: Tensor, grid: Grid) -> Tensor:
    """The value of the map at the centre of each cell, (B, h, w)."""
    x, y = grid.cells.long().unbind(-1)
    return instances[:, y, x].long()
