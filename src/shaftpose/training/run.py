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
from shaftpose.network.checkpoint import resumed_step
from shaftpose.stage_files import DataRecord, TrainingRecord, read_training
from shaftpose.training.assembly import build_module, build_trainer, training_data
from shaftpose.training.curves import Curves
from shaftpose.training.data_identity import about_data
from shaftpose.training.module import ShaftModule
from shaftpose.training.recipe import Recipe, fingerprint
from shaftpose.training.resume import LAST_CHECKPOINT, kept

logger = logging.getLogger(__name__)

# The files of a training's result, in the order of writing.
RESULT = CHECKPOINT, CURVES, FACTS = "model.ckpt", "curves.csv", "training.json"

# Opens a tracked run from the training's id, its parameters and the digests of its data.
Tracker = Callable[[str, dict[str, Any], dict[str, str]], AbstractContextManager[Logger]]


def train(recipe: Recipe, scratch: Path, out: Path, profile: str, tracker: Tracker) -> None:
    """Write `model.ckpt`, `curves.csv` and `training.json` to `out`.

    State and result are kept in `scratch` under the training's fingerprint: an interrupted training
    is resumed, a finished one is not repeated. In a distributed training all processes run this,
    and the first one keeps the records. profile: its name, for the run's parameters.
    """
    recipe = recipe.resolved()
    out.mkdir(parents=True, exist_ok=True)
    seed_everything(recipe.seed, verbose=False)
    with_real, start = recipe.variant.real_share > 0, recipe.variant.start
    about = about_data(with_real, start)
    identity = fingerprint(recipe, about)
    # Jobs of a sweep are trained and tracked by themselves, even if `models/` has their result.
    place = hashlib.sha256(str(out).encode()).hexdigest()[:8]
    folder = scratch / "training" / f"{identity}-{place}"
    title = recipe.variant.title
    if is_finished(folder):
        logger.info("training %s: finished; its result is in %s", title, folder)
        rank_zero_only(deliver)(recipe, folder, out)
        return
    curves, skipped = Curves(), SkippedImages(folder / "skipped_images.txt")
    trainer, module = build_trainer(recipe, folder, curves), build_module(recipe)
    data = training_data(recipe, skipped, module.network.needs_instances)
    if not trainer.is_global_zero:
        fit(trainer, module, data, folder)
        return
    with kept(folder) as training_id:
        if is_finished(folder):  # by another process, before it gave the lock back
            deliver(recipe, folder, out)
            return
        (out / FACTS).unlink(missing_ok=True)  # from another training, whose files get overwritten
        size = recipe.size
        logger.info("training %s: %d steps of %d images", title, size.steps, size.batch_size)
        parameters = recipe.parameters() | {
            "profile": profile,
            "training_images": about.training_images,
            "torch": torch.__version__,
        }
        with tracker(training_id, parameters, digests(about)) as run_logger:
            trainer.loggers = [curves, run_logger]
            fit(trainer, module, data, folder)
        if trainer.global_step < size.steps:
            logger.info("ended by training.max_hours after %d steps", trainer.global_step)
        curves.write(folder / CURVES)
        facts = TrainingRecord(
            training_id=training_id,
            fingerprint=identity,
            seed=recipe.seed,
            data=about,
            variant=recipe.variant_key(),
            recipe=recipe.comparison_key(),
            skipped_images=len(skipped.complaints()),
            steps=trainer.global_step,
            parameters=sum(weight.numel() for weight in module.network.parameters()),
        )
        write_json(folder / FACTS, asdict(facts))
    deliver(recipe, folder, out)
    logger.info("checkpoint and learning curves are in %s", out)


def digests(data: DataRecord) -> dict[str, str]:
    """The digests of rendered and of real training images, for the tracked run."""
    return {"digest": data.digest} | (
        {"real_digest": data.mixed_in.digest} if data.mixed_in else {}
    )


def is_finished(folder: Path) -> bool:
    """Whether a training's folder holds its complete result."""
    return all((folder / name).is_file() for name in RESULT)


def deliver(recipe: Recipe, folder: Path, out: Path) -> None:
    """Copy a result to `out`, whose files may be links into DVC's cache.

    The settings that compared trainings share may have changed since, where this variant does not
    read them.
    """
    for name in (CHECKPOINT, CURVES):
        with new_file(out / name) as part:
            shutil.copyfile(folder / name, part)
    facts = read_training(folder, "delete the folder, then train again")
    write_json(out / FACTS, asdict(replace(facts, recipe=recipe.comparison_key())))


def fit(trainer: Trainer, module: ShaftModule, data: TrainingData, folder: Path) -> None:
    """Train, from the last checkpoint in `folder` if there is one; write `model.ckpt` there."""
    last = folder / LAST_CHECKPOINT
    if last.is_file():
        logger.info("resuming at step %d from %s", resumed_step(last, module.identity), last)
    try:
        trainer.fit(module, data, ckpt_path=last if last.is_file() else None, weights_only=True)
    except SystemExit as stop:  # Lightning's answer to Ctrl-C
        raise KeyboardInterrupt from stop
    trainer.save_checkpoint(folder / CHECKPOINT, weights_only=True)
