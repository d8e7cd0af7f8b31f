"""The module of a training, and Lightning's Trainer for it."""

import logging
import signal
import sys
import warnings
from dataclasses import asdict
from datetime import timedelta
from pathlib import Path
from typing import Any

from lightning import Callback, LightningModule, Trainer
from lightning.pytorch.callbacks import (
    EarlyStopping,
    EMAWeightAveraging,
    LearningRateMonitor,
    Timer,
    TQDMProgressBar,
)
from lightning.pytorch.utilities.exceptions import MisconfigurationException

from shaftpose.core.errors import InputError
from shaftpose.network.building import identity, initial_network
from shaftpose.settings.schema import TrainingSettings
from shaftpose.training.curves import Curves
from shaftpose.training.module import ShaftModule
from shaftpose.training.recipe import Recipe
from shaftpose.training.resume import BEST_CHECKPOINT, LAST_CHECKPOINT, LastCheckpoint
from shaftpose.training.validation_metrics import MERIT, BestWeights, ValidationMetrics

# Hide Lightning's remarks on hardware and its own products; progress and errors still show.
logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)
# Lightning does not know that `TrainingData` starts at the trainer's step.
warnings.filterwarnings("ignore", "You're resuming from a checkpoint that ended before the epoch")


def build_module(recipe: Recipe) -> ShaftModule:
    """The network with its loss and optimiser."""
    variant, size = recipe.variant, recipe.size
    network = initial_network(variant)
    if recipe.training.compile:
        network.compile()  # in place, so that weight names do not change
    return ShaftModule(
        network=network,
        identity=identity(variant),
        limits=recipe.detection,
        optimizer=size.optimizer,
        learning_rate=size.learning_rate,
        total_steps=size.steps,
        warmup_steps=size.warmup_steps,
        frozen_norm_share=recipe.training.frozen_norm_share,
    )


def build_trainer(recipe: Recipe, folder: Path, curves: Curves) -> Trainer:
    """A trainer for one pass over the stream. It validates every `validate_every` steps and after
    the last one, also if `max_hours` or `patience` ends the training.

    folder: for checkpoints to resume from. Raises InputError if this machine cannot provide
    `trainer`.
    """
    settings, size = recipe.training, recipe.size
    assert size.precision != "auto"  # see `Recipe.resolved`
    shows_progress = sys.stderr.isatty()  # a file would be filled with bars
    callbacks: list[Callback] = [
        *([TQDMProgressBar(refresh_rate=20)] if shows_progress else []),
        LearningRateMonitor("step"),
        ValidationMetrics(),
        TimeLimit(settings.max_hours),
        *_best_of_validations(settings, folder),
        LastCheckpoint(folder / LAST_CHECKPOINT, settings.checkpoint_minutes, curves),
        EndAtOnce(),
    ]
    if settings.ema_decay is not None:
        callbacks.append(EMAWeightAveraging(use_buffers=False, decay=settings.ema_decay))
    trainer = asdict(recipe.trainer)
    try:
        return Trainer(
            **trainer,
            precision=size.precision,
            max_epochs=1,
            max_steps=size.steps,
            val_check_interval=min(size.validate_every, size.steps),
            log_every_n_steps=min(25, size.steps),
            gradient_clip_val=settings.gradient_clip,
            logger=[curves],
            callbacks=callbacks,
            default_root_dir=folder,
            enable_model_summary=False,
            enable_progress_bar=shows_progress,
            use_distributed_sampler=False,  # `TrainingData` splits the batches among ranks
        )
    except (MisconfigurationException, ValueError) as error:
        reason = " ".join(str(error).split())  # may have several lines
        raise InputError(f"trainer = {trainer}: {reason}; see conf/trainer") from error


def _best_of_validations(settings: TrainingSettings, folder: Path) -> list[Callback]:
    """What keeps the weights with the best validation mAP, and ends trainings without progress."""
    found: list[Callback] = []
    if settings.keep_best:
        found.append(BestWeights(folder / BEST_CHECKPOINT))
    if settings.patience is not None:
        found.append(
            EarlyStopping(
                MERIT, mode="max", patience=settings.patience, check_on_train_epoch_end=False
            )
        )
    return found


class TimeLimit(Timer):
    """Ends a training after `hours` in total; checkpoints store the elapsed time.

    A resumed training takes one step even if its time is over: Lightning validates after the last
    step only if it ran that step.
    """

    def __init__(self, hours: float | None) -> None:
        super().__init__(None if hours is None else timedelta(hours=hours))

    def on_fit_start(self, trainer: Trainer, *args: Any, **kwargs: Any) -> None:
        """Skip Lightning's check of the time before the first step."""


class EndAtOnce(Callback):
    """Makes SIGTERM end a training as Ctrl-C does; the training resumes from its checkpoint.

    Lightning would finish the step first. In a distributed training it would hang: its handler
    broadcasts to ranks that wait for other messages.
    """

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Replace Lightning's handler; Lightning restores the original one at the end."""
        signal.signal(signal.SIGTERM, signal.default_int_handler)
