"""E's loss: mask, tips and poses."""

import torch
from pydantic import ConfigDict
from pydantic.dataclasses import dataclass
from torch import Tensor
from torch.nn import functional

from shaftpose.core.instruments import UNKNOWN
from shaftpose.dataset.batches import Targets
from shaftpose.network.dense.pinhole import Pinhole
from shaftpose.network.dense.targets import dense_targets
from shaftpose.settings.schema import Positive

_BORDER_REACH_PX = 8  # beyond which a border's weight is left out


@dataclass(frozen=True, config=ConfigDict(extra="forbid", allow_inf_nan=False))
class DenseLoss:
    """The loss of a batch. conf/variant/e.yaml explains the weights."""

    mask: Positive
    border: Positive
    border_px: Positive
    tip_cells: Positive
    smooth: Positive

    def __call__(
        self, mask: Tensor, maps: Tensor, targets: Targets, pinhole: Pinhole
    ) -> dict[str, Tensor]:
        """`loss` = `mask` + `tip` + `pose`, scalars in float32.

        mask: (B, 1, h, w) logits; maps: (B, 7, cells, cells).
        """
        truth = dense_targets(targets, maps.shape[-1], pinhole)
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
        instances: (B, H, W), see `Targets`; pixels that are `UNKNOWN` count nothing.
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
        """Smooth L1 of tip offset, tip depth and axis where they count, averaged over the cells of
        shafts."""
        errors = functional.smooth_l1_loss(values, truth, reduction="none", beta=self.smooth)
        cells = counts.any(1).sum().clamp(min=1)
        return (errors * counts).sum(1).sum() / cells
