"""A short training, distributed over processes: `rank_process.py RANKS FOLDER`.

Lightning starts this script again for each further rank. The first rank writes its results.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import torch
from lightning import Callback, Trainer

from shaftpose.core.instruments import Annotations
from shaftpose.dataset.batches import LabelledImage
from shaftpose.dataset.labelled_images import Images
from shaftpose.dataset.training_data import TrainingData
from shaftpose.dataset.training_stream import TrainingStream
from shaftpose.network.ssd.pose_coding import RegressionCoder
from shaftpose.training.curves import Curves
from shaftpose.training.module import ShaftModule
from tests.network.tiny import LIMITS, tiny_d

SIDE, BATCH, STEPS = 299, 4, 3
LOW, HIGH = np.array([-20.0, -20, 10, 50, 0]), np.array([20.0, 20, 40, 90, 358])


class Noise(Images):
    """Image n is noise with n modulo 4 instruments: ranks have different numbers of matches."""

    def __len__(self) -> int:
        return 8

    def __getitem__(self, index: int) -> LabelledImage:
        rng, count = np.random.default_rng(index), index % 4
        corner = rng.uniform(0, 100, (count, 2))
        boxes = np.hstack([corner, corner + rng.uniform(50, 190, (count, 2))])
        annotations = Annotations(boxes, rng.uniform(LOW, HIGH, (count, 5)))
        return rng.integers(0, 256, (SIDE, SIDE, 3), dtype=np.uint8), annotations


class FirstGradient(Callback):
    """Keeps the gradient of the first step."""

    def __init__(self) -> None:
        self.value = torch.zeros(0)

    def on_before_optimizer_step(self, trainer: Trainer, module: Any, optimizer: Any) -> None:
        if trainer.global_step == 0:
            gradients = [weight.grad for weight in module.parameters() if weight.grad is not None]
            self.value = torch.cat([gradient.flatten() for gradient in gradients])


def build_module() -> ShaftModule:
    """A tiny network with fixed batch normalisation statistics: those of a batch would differ
    between ranks, and torch does not synchronise them on a CPU."""
    network = tiny_d(RegressionCoder(tuple(LOW), tuple(HIGH)))
    return ShaftModule(
        network, {}, LIMITS, "adam", learning_rate=1e-3, total_steps=STEPS, warmup_steps=0,
        frozen_norm_share=1.0,
    )  # fmt: skip


def train(ranks: int, folder: Path) -> dict[str, Any]:
    """The rows of the learning curves and the first gradient."""
    curves, gradient = Curves(), FirstGradient()
    stream = TrainingStream(Noise(), None, 0.0, (), length=STEPS * BATCH, seed=3)
    trainer = Trainer(
        accelerator="cpu", devices=ranks, strategy="ddp" if ranks > 1 else "auto",
        max_steps=STEPS, val_check_interval=STEPS, log_every_n_steps=1, logger=[curves],
        callbacks=[gradient], default_root_dir=folder, enable_checkpointing=False,
        enable_progress_bar=False, enable_model_summary=False, use_distributed_sampler=False,
    )  # fmt: skip
    trainer.fit(build_module(), TrainingData(stream, Noise(), BATCH, 0))  # type: ignore[arg-type]
    seen = {"rows": curves.rows, "gradient": gradient.value}
    if trainer.is_global_zero:
        torch.save(seen, folder / "seen.pt")
    return seen


if __name__ == "__main__":
    train(int(sys.argv[1]), Path(sys.argv[2]))
