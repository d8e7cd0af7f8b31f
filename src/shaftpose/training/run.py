"""Runs one training, from its recipe to a checkpoint and learning curves."""

import hashlib
import logging
import shutil
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import torch
from lightning import Trainer, seed_everything
from lightning.pytorch.loggers import Logger
from lightning.pytorch.utilities import rank_zero_only

from shaftpose.core.files import new_file, write_json
from shaftpose.dataset.training_data import TrainingData
from shaftpose.dataset.training_stream import SkippedImages
from shaftpose.network.checkpoint import is_intact, resumed_step
from shaftpose.stage_files import DataRecord, TrainingRecord, read_training
from shaftpose.training.assembly import build_module, build_trainer
from shaftpose.training.curves import Curves
from shaftpose.training.data import DataFolders, training_data
from shaftpose.training.fingerprint import data_record, fingerprint
from shaftpose.training.module import ShaftModule
from shaftpose.training.recipe import Recipe
from shaftpose.training.resume import (
    BEST_CHECKPOINT,
    LAST_CHECKPOINT,
    locked_training_folder,
)

logger = logging.getLogger(__name__)

# The files of a training's result, in the order of writing.
RESULT = CHECKPOINT, CURVES, RECORD = "model.ckpt", "curves.csv", "training.json"

# Opens a tracked run of a training's id, its parameters and the digests of its data.
OpenTrackedRun = Callable[[str, dict[str, Any], dict[str, str]], AbstractContextManager[Logger]]


def train(
    recipe: Recipe,
    folders: DataFolders,
    scratch: Path,
    out: Path,
    profile: str,
    open_tracked_run: OpenTrackedRun,
) -> None:
    """Write `model.ckpt`, `curves.csv` and `training.json` to `out`.

    State and result are kept in `scratch` under the training's fingerprint: an interrupted training
    is resumed, a finished one is not repeated. In a distributed training all processes run this,
    and the first one keeps the records. profile: its name, for the run's parameters.
    """
    recipe = recipe.resolved()
    out.mkdir(parents=True, exist_ok=True)
    seed_everything(recipe.seed, verbose=False)
    data_used = data_record(folders, recipe.variant.real_share > 0, recipe.variant.start)
    identity = fingerprint(recipe, data_used)
    folder = result_folder(scratch, identity, out)
    title = recipe.variant.title
    if is_finished(folder):
        logger.info("training %s: finished; its result is in %s", title, folder)
        rank_zero_only(deliver)(recipe, folder, out)
        return
    curves, skipped = Curves(), SkippedImages(folder / "skipped_images.txt")
    trainer, module = build_trainer(recipe, folder, curves), build_module(recipe)
    data = training_data(recipe, folders, skipped, module.network.needs_instances)
    if not trainer.is_global_zero:
        fit(trainer, module, data, folder)
        return
    with locked_training_folder(folder) as training_id:
        if is_finished(folder):  # by another process, before it gave the lock back
            deliver(recipe, folder, out)
            return
        (out / RECORD).unlink(missing_ok=True)  # from another training; its other files follow
        size = recipe.size
        logger.info("training %s: %d steps of %d images", title, size.steps, size.batch_size)
        parameters = run_parameters(recipe, data_used, profile)
        with open_tracked_run(training_id, parameters, digests(data_used)) as run_logger:
            trainer.loggers = [curves, run_logger]
            fit(trainer, module, data, folder)
        curves.write(folder / CURVES)
        record = TrainingRecord(
            training_id=training_id,
            fingerprint=identity,
            seed=recipe.seed,
            data=data_used,
            variant=recipe.variant_key(),
            recipe=recipe.comparison_key(),
            skipped_images=len(skipped.complaints()),
            steps=trainer.global_step,
            parameters=sum(weight.numel() for weight in module.network.parameters()),
        )
        write_json(folder / RECORD, asdict(record))
    deliver(recipe, folder, out)
    logger.info("checkpoint and learning curves are in %s", out)


def result_folder(scratch: Path, identity: str, out: Path) -> Path:
    """The folder of a training's state and result.

    Its name depends on `out`, so that jobs of a sweep are trained and tracked by themselves, even
    if `models/` has their result.
    """
    place = hashlib.sha256(str(out).encode()).hexdigest()[:8]
    return scratch / "training" / f"{identity}-{place}"


def run_parameters(recipe: Recipe, data: DataRecord, profile: str) -> dict[str, Any]:
    """The parameters of the tracked run."""
    return recipe.parameters() | {
        "profile": profile,
        "training_images": data.training_images,
        "torch": torch.__version__,
    }


def digests(data: DataRecord) -> dict[str, str]:
    """The digests of rendered and of real training images, for the tracked run."""
    return {"digest": data.digest} | (
        {"real_digest": data.mixed_in.digest} if data.mixed_in else {}
    )


def is_finished(folder: Path) -> bool:
    """Whether a training's folder holds its complete result, undamaged."""
    return all((folder / name).is_file() for name in RESULT) and is_intact(folder / CHECKPOINT)


def deliver(recipe: Recipe, folder: Path, out: Path) -> None:
    """Copy a result to `out`, whose files may be links into DVC's cache.

    Records today's `comparison_key`: settings that this variant does not read may have changed
    since the training.
    """
    for name in (CHECKPOINT, CURVES):
        with new_file(out / name) as part:
            shutil.copyfile(folder / name, part)
    record = read_training(folder, "delete the folder, then train again")
    write_json(out / RECORD, asdict(replace(record, recipe=recipe.comparison_key())))


def fit(trainer: Trainer, module: ShaftModule, data: TrainingData, folder: Path) -> None:
    """Train, from the last checkpoint in `folder` if there is one; write `model.ckpt` there."""
    last = folder / LAST_CHECKPOINT
    if last.is_file():
        logger.info("resuming at step %d from %s", resumed_step(last, module.identity), last)
    try:
        trainer.fit(module, data, ckpt_path=last if last.is_file() else None, weights_only=True)
    except SystemExit as stop:  # Lightning's answer to Ctrl-C
        raise KeyboardInterrupt from stop
    if trainer.global_step < module.total_steps:
        logger.info("ended by max_hours or patience after %d steps", trainer.global_step)
    trainer.save_checkpoint(folder / CHECKPOINT, weights_only=True)
    if trainer.is_global_zero and (folder / BEST_CHECKPOINT).is_file():
        # Copied: a training that fails after this is resumed from before its last validation.
        with new_file(folder / CHECKPOINT) as part:
            shutil.copyfile(folder / BEST_CHECKPOINT, part)
