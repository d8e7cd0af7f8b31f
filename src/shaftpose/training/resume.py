"""The folder of an unfinished training: its lock, and the state from which it resumes."""

import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch
from filelock import AcquireReturnProxy, FileLock, Timeout
from lightning import LightningModule, Trainer
from lightning.pytorch.callbacks import Checkpoint
from torch import Tensor

from shaftpose.core.errors import InputError
from shaftpose.core.files import new_file
from shaftpose.training.curves import Curves

LAST_CHECKPOINT, BEST_CHECKPOINT = "last.ckpt", "best.ckpt"

# The data loaders of a killed training hold its lock until they exit, within seconds.
_PATIENCE_S = 30.0


@contextmanager
def locked_training_folder(folder: Path) -> Iterator[str]:
    """Hold the lock of a training whose state and result are in `folder`.

    Yields the training's id, which stays the same after a resume. Removes its checkpoints when the
    training is finished. Raises InputError if another process runs the same training.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    with _held(folder.with_suffix(".lock")):
        folder.mkdir(exist_ok=True)
        yield _training_id(folder / "training_id")
        for name in (LAST_CHECKPOINT, BEST_CHECKPOINT):
            (folder / name).unlink(missing_ok=True)


def _held(path: Path) -> AcquireReturnProxy:
    try:
        return FileLock(path).acquire(timeout=_PATIENCE_S)
    except Timeout as error:
        raise InputError(
            f"{path}: another process trains with these settings; wait for it or stop it"
        ) from error


def _training_id(note: Path) -> str:
    if not note.is_file():
        with new_file(note) as part:
            part.write_text(uuid.uuid4().hex)
    return note.read_text()


class LastCheckpoint(Checkpoint):
    """Writes the state of a training after each validation and every `minutes` in between.

    The state is Lightning's (weights, optimiser, scheduler, step), torch's random states and the
    curves so far. The step is also the position in the data, see `TrainingStream`. The file at
    `path` is replaced atomically.

    Nothing is written after the last step: a training killed there resumes from the checkpoint
    before and repeats the last validation.
    """

    def __init__(self, path: Path, minutes: float, curves: Curves) -> None:
        self._path, self._seconds, self._curves = path, 60 * minutes, curves
        self._written_at = 0.0
        self._random: dict[str, Tensor] = {}

    def state_dict(self) -> dict[str, Any]:
        """The state that Lightning does not save itself."""
        return {"random": _random_states(), "curves": self._curves.rows}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Restore the curves, and keep the random states until the training starts."""
        self._random, self._curves.rows = state_dict["random"], state_dict["curves"]

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Restore the random states, because Lightning's setup has drawn random numbers."""
        self._written_at = time.monotonic()
        _set_random_states(self._random)

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        """Write the state if it is due and this step is complete."""
        due = time.monotonic() - self._written_at >= self._seconds
        # Each rank has its own clock, but all ranks must write together.
        if _step_is_over(trainer) and trainer.strategy.broadcast(due):
            self._write(trainer)

    def on_validation_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Write the state, unless the training is over or has not begun."""
        if not trainer.sanity_checking and not trainer.should_stop:
            self._write(trainer)

    def _write(self, trainer: Trainer) -> None:
        part = self._path.with_suffix(".part")
        trainer.save_checkpoint(part)
        if trainer.is_global_zero:
            part.replace(self._path)
        self._written_at = time.monotonic()


def _step_is_over(trainer: Trainer) -> bool:
    """Whether nothing of a step follows `on_train_batch_end`: neither validation nor logging, which
    a training resumed from there would skip."""
    step, validate_every = trainer.global_step, trainer.val_check_batch
    assert validate_every is not None  # set once training has started
    log_every: int = trainer.log_every_n_steps  # type: ignore[attr-defined]
    return not trainer.should_stop and step % validate_every != 0 and step % log_every != 0


def _random_states() -> dict[str, Tensor]:
    states = {"cpu": torch.get_rng_state()}
    if torch.cuda.is_available():
        states["cuda"] = torch.cuda.get_rng_state()
    return states


def _set_random_states(states: dict[str, Tensor]) -> None:
    if "cpu" in states:
        torch.set_rng_state(states["cpu"])
    if "cuda" in states and torch.cuda.is_available():
        torch.cuda.set_rng_state(states["cuda"])
