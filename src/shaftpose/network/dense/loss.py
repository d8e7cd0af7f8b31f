"""E's loss: mask, tips and poses, with their targets for each cell of the maps."""

from typing import NamedTuple

import torch
from pydantic import ConfigDict
from pydantic.dataclasses import dataclass
from torch import Tensor
from torch.nn import functional

from shaftpose.core.instruments import UNKNOWN
from shaftpose.dataset.batches import Targets
from shaftpose.network.dense.coding import (
    OFFSET_SCALE_PX,
    Grid,
    encoded_axis,
    encoded_depth,
)
from shaftpose.network.pose_network import gather_rows
from shaftpose.settings.schema import Positive

_BORDER_REACH_PX = 8  # beyond which a border's weight is left out
_HEAT_PX = 6.0  # standard deviation of a tip's heat


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
        """`loss` = `mask` + `tip` + `pose`, scalars in float32.

        mask: (B, 1, h, w) logits; maps: (B, 7, h, w) in the cells of `grid`.
        """
        truth = dense_targets(targets, grid)
        assert targets.instances is not None
        terms = {
            "mask": self.mask_loss(mask.float(), targets.instances),
            "tip": self.tip_loss(maps[:, 0].float().sigmoid(), truth.heat, truth.has_heat),
            "pose": self.pose_loss(maps[:, 1:].float(), truth.values, truth.counts),
        }
        return {"loss": torch.stack(list(terms.values())).sum(), **terms}

    def mask_loss(self, logits: Tensor, instances: Tensor) -> Tensor:
        """Border-weighted cross-entropy plus Dice loss, at the image's resolution.

        Upsampling before the loss lets a half-resolution mask learn subpixel edges.
        instances: (B, H, W), see `Targets`; pixels that are `UNKNOWN` do not count.
        """
        known = instances != UNKNOWN
        truth = (known & (instances > 0)).float()
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
        near = -functional.max_pool2d(-truth, 3, 1, 1) != functional.max_pool2d(truth, 3, 1, 1)
        decay = torch.exp(truth.new_tensor(-1 / self.border_px))
        closeness = near.float()
        for _ in range(_BORDER_REACH_PX):
            closeness = torch.maximum(closeness, decay * functional.max_pool2d(closeness, 3, 1, 1))
        return 1 + self.border * closeness

    def tip_loss(self, heat: Tensor, truth: Tensor, known: Tensor) -> Tensor:
        """The focal loss of the tip heat maps (CornerNet), per image and tip cell."""
        hit = (1 - heat).square() * truth * (heat + 1e-6).log() * (truth > 0.5)
        miss = (1 - truth).pow(4) * heat.square() * (1 - heat + 1e-6).log()
        losses = -(hit + miss).sum(dim=(1, 2)) * known
        return losses.sum() / (self.tip_cells * known.sum().clamp(min=1))

    def pose_loss(self, values: Tensor, truth: Tensor, counts: Tensor) -> Tensor:
        """Smooth L1 of tip offset, depth and axis where they are known, per cell on a shaft."""
        errors = functional.smooth_l1_loss(values, truth, reduction="none", beta=self.smooth)
        cells = counts.any(1).sum().clamp(min=1)
        return (errors * counts).sum(1).sum() / cells


class DenseTargets(NamedTuple):
    """Targets of E's maps, cell by cell.

    heat: (B, h, w) in [0, 1]; has_heat: (B,) bool, whether all tips of the image are known; values:
    (B, 6, h, w), see `coding`; counts: the same shape, bool, where they are known.
    """

    heat: Tensor
    has_heat: Tensor
    values: Tensor
    counts: Tensor


def dense_targets(targets: Targets, grid: Grid) -> DenseTargets:
    """The targets of a batch in the cells (h, w) of a grid.

    Images without poses have heat and offsets where tips are known.
    """
    assert targets.instances is not None, "this network needs instance masks for training"
    centres = grid.cells
    has_pose = targets.valid & targets.has_pose[:, None]
    poses = torch.where(has_pose[..., None], targets.poses, torch.ones_like(targets.poses))
    tips, has_tip = _tips(targets, poses, has_pose, grid)
    rows = torch.cat([tips, encoded_depth(poses[..., 2:3]), encoded_axis(poses)], dim=-1)
    known = torch.cat(
        [has_tip[..., None].expand(-1, -1, 2), has_pose[..., None].expand(-1, -1, 4)], dim=-1
    )
    shaft = _coarse(targets.instances, grid) - 1
    on_shaft = (shaft >= 0) & (shaft < rows.shape[1])  # else background or unknown
    shaft = torch.where(on_shaft, shaft, 0).flatten(1)
    values, counts = (gather_rows(r, shaft).unflatten(1, centres.shape[:2]) for r in (rows, known))
    offsets = (values[..., :2] - centres) / OFFSET_SCALE_PX
    values = torch.cat([offsets, values[..., 2:]], dim=-1)
    # A left-out shaft may have its tip in an image without other shafts.
    has_unknown = (targets.instances == UNKNOWN).flatten(1).any(1)
    return DenseTargets(
        heat=_heat(tips, has_tip, centres),
        has_heat=(has_tip | ~targets.valid).all(1) & (targets.valid.any(1) | ~has_unknown),
        values=values.permute(0, 3, 1, 2),
        counts=(counts & on_shaft[..., None]).permute(0, 3, 1, 2),
    )


def _tips(targets: Targets, poses: Tensor, has_pose: Tensor, grid: Grid) -> tuple[Tensor, Tensor]:
    """Tips (B, G, 2) px, from poses where there are any, and whether they are known (B, G)."""
    tips = grid.project(poses[..., :3])
    if targets.tips_px is None:
        return tips, has_pose
    annotated = targets.valid & ~has_pose & targets.tips_px.isfinite().all(-1)
    return torch.where(annotated[..., None], targets.tips_px, tips), has_pose | annotated


def _heat(tips: Tensor, has_tip: Tensor, centres: Tensor) -> Tensor:
    """The largest of the Gaussians around known tips (B, G, 2) px, (B, h, w)."""
    distance = (centres[None, None] - tips[:, :, None, None]).square().sum(-1)
    heat = torch.exp(-distance / (2 * _HEAT_PX**2)) * has_tip[..., None, None]
    return heat.amax(1)


def _coarse(instances: Tensor, grid: Grid) -> Tensor:
    """The number of the shaft at the centre of each cell, (B, h, w), from 1; 0 for none."""
    x, y = grid.cells.long().unbind(-1)
    return instances[:, y, x].long()
