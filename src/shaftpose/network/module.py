"""Training: one step, its learning rate, and what is logged."""

from pathlib import Path
from typing import Literal

import numpy as np
import torch
from lightning import LightningModule
from lightning.pytorch.utilities.types import OptimizerLRScheduler
from torch import Tensor
from torch.nn.utils import get_total_norm

from shaftpose.batches import Batch
from shaftpose.errors import InputError
from shaftpose.network import ranks
from shaftpose.network.decoding import decode
from shaftpose.network.heads import HeadOutputs
from shaftpose.network.layers import ConvBNReLU, freeze_statistics
from shaftpose.network.loss import LossTerms, ShaftLoss
from shaftpose.network.muon import Muon
from shaftpose.network.shaft_network import ShaftNetwork, normalise_images

DECAY_POWER = 2.0  # of the learning rate's polynomial decay, as in the paper
MUON_RATIO = 5.0  # of Muon's learning rate to that of Adam


class ShaftModule(LightningModule):
    """Trains a `ShaftNetwork`: linear warm-up, then polynomial decay, by steps.

    `optimizer`: Adam for all weights, or Muon for the convolutions with batch normalisation and
    Adam for the others, whose learning rate is `learning_rate`. `identity` (variant, width, depth)
    says which network the weights in a checkpoint belong to. In the last steps, a share
    `frozen_norm_share` of all, batch normalisation works as it does in the finished network.
    """

    def __init__(
        self,
        network: ShaftNetwork,
        loss: ShaftLoss,
        identity: dict[str, str | float],
        optimizer: Literal["adam", "muon"],
        learning_rate: float,
        total_steps: int,
        warmup_steps: int,
        frozen_norm_share: float = 0.0,
    ) -> None:
        super().__init__()
        # torch's type hints for `Module.to` leave this argument out.
        self.network: ShaftNetwork = network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.loss = loss
        self.identity = identity
        self.optimizer = optimizer
        self.learning_rate = learning_rate
        self.total_steps = total_steps
        self.warmup_steps = warmup_steps
        self.frozen_norm_from = round(total_steps * (1 - frozen_norm_share))

    def on_train_batch_start(self, batch: Batch, batch_index: int) -> None:
        """Freeze the statistics of batch normalisation when it is time."""
        if self.global_step >= self.frozen_norm_from:
            freeze_statistics(self.network)

    def training_step(self, batch: Batch, batch_index: int) -> Tensor:
        """The scalar loss of a batch.

        Raises InputError if it is no longer a number; the batch is then in the trainer's folder.
        """
        self._batch = batch
        terms = self._loss_terms(self._outputs(batch), batch)
        whole = terms_of_all_ranks(terms)
        self._check_finite("loss", whole.total)
        self._log_terms("training", whole, len(batch.images))
        return terms.total

    def on_before_optimizer_step(self, optimizer: torch.optim.Optimizer) -> None:
        """Raise InputError before gradients that are no numbers spoil the weights.

        They may overflow where the loss does not. In half precision they may do so at any time: the
        scaler of its gradients passes over such steps by itself.
        """
        if self.trainer.precision != "16-mixed":
            weights = self.network.parameters()
            gradients = [weight.grad for weight in weights if weight.grad is not None]
            self._check_finite("gradient's norm", get_total_norm(gradients))

    def validation_step(self, batch: Batch, batch_index: int) -> dict[str, Tensor]:
        """Log the loss of a batch that is not trained on.

        Returns the instruments found as `boxes`, `scores` and `poses` (see `DecodedOutputs`), at
        the thresholds that `decode` has by itself.
        """
        outputs, network = self._outputs(batch), self.network
        self._log_terms("validation", self._loss_terms(outputs, batch), len(batch.images))
        return decode(outputs, network.defaults, network.pose_coder)._asdict()

    def configure_optimizers(self) -> OptimizerLRScheduler:
        """The optimiser, its learning rates multiplied by `learning_rate_factor` at every step."""
        # A fused optimiser undoes the scaling of half precision's gradients by itself, after they
        # would be clipped: Lightning refuses the two together.
        fused = not self.trainer.gradient_clip_val
        optimizer = self._optimizer(fused)
        scheduler = torch.optim.lr_scheduler.LambdaLR(optimizer, self.learning_rate_factor)
        return {
            "optimizer": optimizer,
            "lr_scheduler": {"scheduler": scheduler, "interval": "step"},
        }

    def _optimizer(self, fused: bool) -> torch.optim.Optimizer:
        weights = list(self.network.parameters())
        if self.optimizer == "adam":
            return torch.optim.Adam(weights, lr=self.learning_rate, fused=fused)
        hidden = [m for m in self.network.modules() if isinstance(m, ConvBNReLU)]
        matrices = [module.conv.weight for module in hidden]
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
        """Write the network's identity beside its weights."""
        checkpoint["identity"] = dict(self.identity)

    def _outputs(self, batch: Batch) -> HeadOutputs:
        return self.network(normalise_images(batch.images))

    def _loss_terms(self, outputs: HeadOutputs, batch: Batch) -> LossTerms:
        return self.loss(outputs, batch.targets, self.network.defaults, self.network.pose_coder)

    def _check_finite(self, name: str, value: Tensor) -> None:
        """`value` is the same in all ranks: they stop together."""
        if not torch.isfinite(value):
            raise InputError(
                f"the training {name} is {value.item()} at step {self.global_step}: lower the "
                f"learning rate or lengthen the warm-up; {self._write_batch()} is the batch"
            )

    def _write_batch(self) -> Path:
        name = f"batch-of-step-{self.global_step}-rank-{self.global_rank}.npz"
        path = Path(self.trainer.default_root_dir) / name
        tensors = {"images": self._batch.images, **self._batch.targets._asdict()}
        arrays: dict[str, np.ndarray] = {key: t.cpu().numpy() for key, t in tensors.items()}
        np.savez(path, **arrays)
        return path

    def _log_terms(self, phase: str, terms: LossTerms, batch_size: int) -> None:
        values = {f"{phase}/{name}": value.float() for name, value in terms._asdict().items()}
        values[f"{phase}/loss"] = values.pop(f"{phase}/total")
        self.log_dict(values, batch_size=batch_size, sync_dist=phase == "validation")


def terms_of_all_ranks(terms: LossTerms) -> LossTerms:
    """The loss of a batch from those of the ranks that share it: means, and the sum of matches."""
    total = LossTerms(*ranks.total(torch.stack(terms)))
    mean = LossTerms(*(value / ranks.count() for value in total))
    return mean._replace(matched=total.matched)
