"""The Lightning module of a training: its steps, learning rate and logged values."""

from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from lightning import LightningModule
from lightning.pytorch.utilities.types import OptimizerLRScheduler
from torch import Tensor, nn
from torch.nn.utils import get_total_norm

from shaftpose.core.errors import InputError
from shaftpose.dataset.batches import Batch
from shaftpose.network.checkpoint import Identity
from shaftpose.network.pose_network import (
    COUNTS,
    PoseNetwork,
    normalise_images,
    rank_count,
    sum_over_ranks,
)
from shaftpose.settings.schema import DetectionSettings
from shaftpose.training.muon import Muon

DECAY_POWER = 2.0  # exponent of the learning rate's polynomial decay, as in the paper
MUON_RATIO = 5.0  # Muon's learning rate relative to Adam's


class ShaftModule(LightningModule):
    """Trains a `PoseNetwork` with linear warm-up, then polynomial decay, by steps.

    optimizer: Adam for all weights, or Muon for the convolutions with batch normalisation that
    start from random weights and Adam for the others; learning_rate: Adam's; identity: stored in
    checkpoints, see `Identity`; frozen_norm_share: share of the steps, at the end, in which batch
    normalisation uses its running statistics, as in the finished network.
    """

    def __init__(
        self,
        network: PoseNetwork,
        identity: Identity,
        limits: DetectionSettings,
        optimizer: Literal["adam", "muon"],
        learning_rate: float,
        total_steps: int,
        warmup_steps: int,
        frozen_norm_share: float = 0.0,
    ) -> None:
        super().__init__()
        # torch's type hints for `Module.to` leave this argument out.
        self.network: PoseNetwork = network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.identity = identity
        self.limits = limits
        self.optimizer = optimizer
        self.learning_rate = learning_rate
        self.total_steps = total_steps
        self.warmup_steps = warmup_steps
        self.frozen_norm_from = round(total_steps * (1 - frozen_norm_share))

    def on_train_batch_start(self, batch: Batch, batch_index: int) -> None:
        """Freeze the statistics of batch normalisation in the last steps."""
        if self.global_step >= self.frozen_norm_from:
            freeze_statistics(self.network)

    def training_step(self, batch: Batch, batch_index: int) -> Tensor:
        """The scalar loss of a batch.

        Raises InputError if it is not finite, and writes the batch to the trainer's folder.
        """
        self._batch = batch
        terms = self.network.loss_terms(self._outputs(batch), batch.targets)
        whole = of_all_ranks(terms)
        self._check_finite("loss", whole["loss"])
        self._log_terms("train", whole, len(batch.images))
        return terms["loss"]

    def on_before_optimizer_step(self, optimizer: torch.optim.Optimizer) -> None:
        """Raise InputError before non-finite gradients spoil the weights.

        Gradients may overflow even if the loss does not. In half precision this is normal: the
        gradient scaler skips such steps.
        """
        if self.trainer.precision != "16-mixed":
            weights = self.network.parameters()
            gradients = [weight.grad for weight in weights if weight.grad is not None]
            self._check_finite("gradient's norm", get_total_norm(gradients))

    def validation_step(self, batch: Batch, batch_index: int) -> dict[str, Tensor]:
        """Log the loss of a validation batch.

        Returns the detections as `boxes`, `scores` and `poses` (see `DecodedOutputs`).
        """
        # A compiled network would be compiled again for it, which takes longer than it saves.
        with torch.compiler.set_stance("force_eager"):
            outputs = self._outputs(batch)
        terms = self.network.loss_terms(outputs, batch.targets)
        self._log_terms("validation", terms, len(batch.images))
        return self.network.detections(outputs, self.limits)._asdict()

    def configure_optimizers(self) -> OptimizerLRScheduler:
        """The optimiser, its learning rates multiplied by `learning_rate_factor` at every step."""
        # A fused optimiser unscales half-precision gradients itself, after they would be clipped:
        # Lightning refuses this combination.
        fused = not self.trainer.gradient_clip_val
        optimizer = self._optimizer(fused)
        scheduler = torch.optim.lr_scheduler.LambdaLR(optimizer, self.learning_rate_factor)
        return {
            "optimizer": optimizer,
            "lr_scheduler": {
                "scheduler": scheduler,
                "interval": "step",
                "name": "train/learning_rate",
            },  # fmt: skip
        }

    def _optimizer(self, fused: bool) -> torch.optim.Optimizer:
        weights = list(self.network.parameters())
        if self.optimizer == "adam":
            return torch.optim.Adam(weights, lr=self.learning_rate, fused=fused)
        convolutions = [m for m in self.network.modules() if isinstance(m, nn.Conv2d)]
        # Only prediction convolutions have a bias; batch normalisation makes it superfluous.
        matrices = [w for conv in convolutions if conv.bias is None for w in conv.parameters()]
        # Muon's long steps would undo what an encoder has learned before.
        kept = {id(weight) for weight in self.network.pretrained()}
        matrices = [weight for weight in matrices if id(weight) not in kept]
        chosen = {id(weight) for weight in matrices}
        others = [weight for weight in weights if id(weight) not in chosen]
        rate = self.learning_rate
        return Muon(matrices, others, MUON_RATIO * rate, rate, fused=fused)

    def learning_rate_factor(self, step: int) -> float:
        """Rises to 1 over the warm-up, then falls to 0 at `total_steps`."""
        if step < self.warmup_steps:
            return (step + 1) / self.warmup_steps
        left = (self.total_steps - step) / max(self.total_steps - self.warmup_steps, 1)
        return max(left, 0.0) ** DECAY_POWER

    def on_save_checkpoint(self, checkpoint: dict[str, object]) -> None:
        """Add the network's identity to the checkpoint."""
        checkpoint["identity"] = dict(self.identity)

    def _outputs(self, batch: Batch) -> Any:
        return self.network(normalise_images(batch.images))

    def _check_finite(self, name: str, value: Tensor) -> None:
        """Raise InputError unless `value`, equal on all ranks, is finite: they stop together."""
        if not torch.isfinite(value):
            raise InputError(
                f"the training {name} is {value.item()} at step {self.global_step}: lower the "
                f"learning rate or lengthen the warm-up; the batch is in {self._write_batch()}"
            )

    def _write_batch(self) -> Path:
        name = f"batch-of-step-{self.global_step}-rank-{self.global_rank}.npz"
        path = Path(self.trainer.default_root_dir) / name
        tensors = {"images": self._batch.images, **self._batch.targets._asdict()}
        arrays: dict[str, np.ndarray] = {
            key: t.cpu().numpy() for key, t in tensors.items() if t is not None
        }
        np.savez(path, **arrays)
        return path

    def _log_terms(self, phase: str, terms: dict[str, Tensor], batch_size: int) -> None:
        for name, value in terms.items():
            self.log(
                f"{phase}/{name}", value.float(), batch_size=batch_size,
                sync_dist=phase == "validation",
                prog_bar=(phase, name) == ("train", "loss"),
            )  # fmt: skip


def of_all_ranks(terms: dict[str, Tensor]) -> dict[str, Tensor]:
    """The loss terms of a whole batch, from those of the ranks that share it."""
    totals = dict(zip(terms, sum_over_ranks(torch.stack(list(terms.values()))), strict=True))
    return {name: t if name in COUNTS else t / rank_count() for name, t in totals.items()}


def freeze_statistics(network: nn.Module) -> None:
    """Make batch normalisation use its running statistics without updating them."""
    for module in network.modules():
        if isinstance(module, nn.modules.batchnorm._BatchNorm):  # includes SyncBatchNorm
            module.eval()
