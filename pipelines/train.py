"""Stage `train`: one variant, from lists of images to a checkpoint and learning curves."""

import logging
import signal
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path
from typing import Any

import torch
from digests import about_data
from lightning import Callback, LightningModule, Trainer, seed_everything
from lightning.pytorch.callbacks import (
    EMAWeightAveraging,
    LearningRateMonitor,
    Timer,
    TQDMProgressBar,
)
from lightning.pytorch.loggers import MLFlowLogger
from lightning.pytorch.utilities.exceptions import MisconfigurationException
from networks import identity, initial_network, variant
from results import read_training, write_json
from settings import size
from stage import Config, stage
from unfinished import (
    LAST_CHECKPOINT,
    kept,
    recipe,
    scratch_folder,
    settings_of,
    settings_of_variant,
)
from validation import ValidationMetrics

from shaftpose import tracking
from shaftpose.config import Augmentation, LossSettings, Size, TrainingSettings, Variant, parse
from shaftpose.dataset.coco import read_coco
from shaftpose.dataset.skipped import SkippedImages
from shaftpose.dataset.split import read_keys
from shaftpose.dataset.training_data import (
    RealImages,
    RenderedImages,
    TrainingData,
    TrainingStream,
    Transform,
)
from shaftpose.dataset.transforms import ColourJitter, UniformNoise
from shaftpose.errors import InputError
from shaftpose.network.checkpoint import resumed_step
from shaftpose.network.curves import Curves
from shaftpose.network.last_checkpoint import LastCheckpoint
from shaftpose.network.loss import ShaftLoss
from shaftpose.network.module import ShaftModule
from shaftpose.network.precision import native_precision
from shaftpose.shards import ShardedDataset

logger = logging.getLogger(__name__)

# A training's result; FACTS is written last.
CHECKPOINT, CURVES, FACTS = "model.ckpt", "curves.csv", "training.json"

# Lightning's remarks on hardware and its own products; progress and errors still show.
logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)
# It cannot know that `TrainingData` begins at the trainer's step.
warnings.filterwarnings("ignore", "You're resuming from a checkpoint that ended before the epoch")


@stage
def main(config: Config) -> None:
    """Write `model.ckpt`, `curves.csv` and `training.json` to `out`.

    A training that was interrupted goes on where it was; one whose result is in `out` is not
    repeated. In a distributed training all processes run this, and the first one keeps the records.
    """
    config = with_detector_settings(with_precision(config))
    chosen, sizes, out = variant(config), size(config), Path(config["out"])
    out.mkdir(parents=True, exist_ok=True)
    seed_everything(config["seed"], verbose=False)
    data_facts = about_data(with_real=chosen.real_share > 0, start=chosen.start)
    folder = scratch_folder(config, data_facts)
    if is_finished(out, folder.name):
        logger.info("training %s: finished; its result is in %s", chosen.title, out)
        return
    curves, skipped = Curves(), SkippedImages(folder / "skipped_images.txt")
    trainer = build_trainer(config, sizes, folder, curves)
    module, data = build_module(config, sizes), training_data(config, chosen, sizes, skipped)
    if not trainer.is_global_zero:
        fit(trainer, module, data, folder, out)
        return
    with kept(folder) as training_id:
        (out / FACTS).unlink(missing_ok=True)  # of another training, whose files are overwritten
        logger.info(
            "training %s: %d steps of %d images", chosen.title, sizes.steps, sizes.batch_size
        )
        with tracked(config, data_facts, training_id, out) as mlflow_logger:
            trainer.loggers = [curves, mlflow_logger]
            fit(trainer, module, data, folder, out)
        if trainer.global_step < sizes.steps:
            logger.info("ended by training.max_hours after %d steps", trainer.global_step)
        curves.write(out / CURVES)
        facts = {
            "training_id": training_id,
            "fingerprint": folder.name,
            **data_facts,
            **about_settings(config, sizes),
            "skipped_images": len(skipped.complaints()),
            "steps": trainer.global_step,
            "parameters": sum(weight.numel() for weight in module.network.parameters()),
        }
        write_json(out / FACTS, facts)
    logger.info("checkpoint and learning curves are in %s", out)


def with_detector_settings(config: Config) -> Config:
    """The configuration, for a detector with its own number of steps and with L_pose = 0."""
    if variant(config).pose_loss:
        return config
    sizes = {**config["size"], "steps": config["size"]["detector_steps"]}
    return {**config, "size": sizes, "loss": {**config["loss"], "beta": [0.0] * 5}}


def about_settings(config: Config, sizes: Size) -> dict[str, Any]:
    """What a training is with: what its result is compared by, besides the data."""
    return {
        "batch_size": sizes.batch_size,
        "width": sizes.width,
        "depth": sizes.depth,
        "seed": config["seed"],
        "variant": settings_of_variant(config),
        "recipe": recipe(config),
    }


def with_precision(config: Config) -> Config:
    """The configuration with the device's own precision in the place of `auto`."""
    if config["size"]["precision"] != "auto":
        return config
    precision = native_precision(config["trainer"]["accelerator"])
    return {**config, "size": {**config["size"], "precision": precision}}


def is_finished(out: Path, fingerprint: str) -> bool:
    """Whether `out` holds the whole result of the training of this fingerprint."""
    if not all((out / name).is_file() for name in (CHECKPOINT, CURVES, FACTS)):
        return False
    return bool(read_training(out).get("fingerprint") == fingerprint)


def fit(trainer: Trainer, module: ShaftModule, data: TrainingData, folder: Path, out: Path) -> None:
    """Train, from the last checkpoint in `folder` on if there is one; write `model.ckpt`."""
    last = folder / LAST_CHECKPOINT
    if last.is_file():
        logger.info("going on at step %d with %s", resumed_step(last, module.identity), last)
    try:
        trainer.fit(module, data, ckpt_path=last if last.is_file() else None, weights_only=True)
    except SystemExit as stop:  # Lightning's answer to Ctrl-C
        raise KeyboardInterrupt from stop
    if trainer.is_global_zero:  # it may be a link into DVC's cache, and Lightning may write to it
        (out / CHECKPOINT).unlink(missing_ok=True)
    trainer.save_checkpoint(out / CHECKPOINT, weights_only=True)


@contextmanager
def tracked(
    config: Config, data_facts: dict[str, Any], training_id: str, out: Path
) -> Iterator[MLFlowLogger]:
    """The training's MLflow run."""
    tracking.connect(**config["tracking"])
    digests = {"digest": data_facts["data"]}
    if data_facts["real"]:
        digests["real_digest"] = data_facts["real"]["digest"]
    with tracking.training_run(
        training_id,
        name=config["variant"]["name"],
        parameters=logged_parameters(config, data_facts),
        dataset=tracking.dataset_identity(Path("dvc.lock")) | digests,
        sweep_folder=out.parent,
    ) as mlflow_logger:
        yield mlflow_logger


def build_module(config: Config, sizes: Size) -> ShaftModule:
    """The network with its loss and optimiser."""
    network = initial_network(config)
    loss = parse(LossSettings, config["loss"], "params.yaml: loss")
    settings = training_settings(config)
    if settings.compile:
        network.compile()  # in place: the names of its weights stay as they are
    return ShaftModule(
        network=network,
        loss=ShaftLoss(loss.alpha, loss.beta, loss.gamma),
        identity=identity(config),
        optimizer=sizes.optimizer,
        learning_rate=sizes.learning_rate,
        total_steps=sizes.steps,
        warmup_steps=sizes.warmup_steps,
        frozen_norm_share=settings.frozen_norm_share,
    )


def training_settings(config: Config) -> TrainingSettings:
    """How the network is trained."""
    return parse(TrainingSettings, config["training"], "params.yaml: training")


def training_data(
    config: Config, chosen: Variant, sizes: Size, skipped: SkippedImages
) -> TrainingData:
    """The images of the run, augmented, with real ones mixed in if the variant asks for them."""
    settings = training_settings(config)
    shards, lists = ShardedDataset(Path("data/render/images")), Path("data/split")
    stream = TrainingStream(
        rendered=RenderedImages(shards, read_keys(lists, "train")),
        real=real_images(config["camera"]["size_px"]) if chosen.real_share > 0 else None,
        real_share=chosen.real_share,
        transforms=transforms(settings.augmentation, chosen.noise),
        length=sizes.steps * sizes.batch_size,
        seed=config["seed"],
        skipped=skipped if settings.on_damaged == "skip" else None,
        symmetries=settings.augmentation.symmetries,
    )
    validation = RenderedImages(shards, read_keys(lists, "validation"))
    return TrainingData(stream, validation, sizes.batch_size, settings.loader_workers)


def real_images(size_px: int) -> RealImages:
    """The training part of the real, or stand-in, images."""
    return RealImages(read_coco(Path("data/real/train.json")), size_px)


def transforms(augmentation: Augmentation, noise: int) -> list[Transform]:
    """Colour jitter for every variant, noise where the variant has it."""
    jitter = ColourJitter(
        brightness=augmentation.brightness,
        contrast=augmentation.contrast,
        saturation=augmentation.saturation,
        hue_deg=augmentation.hue_deg,
    )
    return [jitter, UniformNoise(noise)] if noise else [jitter]


def build_trainer(config: Config, sizes: Size, folder: Path, curves: Curves) -> Trainer:
    """One pass over the stream, validated every so many steps and after the last one, also when
    `max_hours` ends it.

    folder: for checkpoints to go on from. Raises InputError if the machine lacks what `trainer`
    asks for.
    """
    settings = training_settings(config)
    assert sizes.precision != "auto"  # see `with_precision`
    callbacks: list[Callback] = [
        TQDMProgressBar(refresh_rate=20),
        LearningRateMonitor("step"),
        ValidationMetrics(),
        TimeLimit(settings.max_hours),
        LastCheckpoint(folder / LAST_CHECKPOINT, settings.checkpoint_minutes, curves),
        EndAtOnce(),
    ]
    if settings.ema_decay is not None:
        callbacks.append(EMAWeightAveraging(use_buffers=False, decay=settings.ema_decay))
    try:
        return Trainer(
            **config["trainer"],
            precision=sizes.precision,
            max_epochs=1,
            max_steps=sizes.steps,
            val_check_interval=min(sizes.validate_every, sizes.steps),
            log_every_n_steps=min(25, sizes.steps),
            gradient_clip_val=settings.gradient_clip,
            logger=[curves],
            callbacks=callbacks,
            default_root_dir=folder,
            enable_model_summary=False,
            use_distributed_sampler=False,  # `TrainingData` shares the batches out
        )
    except (MisconfigurationException, ValueError) as error:
        reason = " ".join(str(error).split())  # of several lines
        raise InputError(f"trainer = {config['trainer']}: {reason}; see conf/trainer") from error


class TimeLimit(Timer):
    """Ends a training after so many hours of it in all: they are counted in its checkpoints.

    A training that goes on takes a step even if its time is over, for Lightning validates after
    the last step only if it has seen it.
    """

    def __init__(self, hours: float | None) -> None:
        super().__init__(None if hours is None else timedelta(hours=hours))

    def on_fit_start(self, trainer: Trainer, *args: Any, **kwargs: Any) -> None:
        """Do not look at the clock yet."""


class EndAtOnce(Callback):
    """Makes the signal to terminate end a training as Ctrl-C does; it goes on from its checkpoint.

    Lightning would finish the step first. In a distributed training it would never get there: its
    handler broadcasts to ranks that await other messages.
    """

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Replace Lightning's handler, which it removes itself in the end."""
        signal.signal(signal.SIGTERM, signal.default_int_handler)


def logged_parameters(config: Config, data_facts: dict[str, Any]) -> dict[str, Any]:
    """What MLflow shows of a training: what determines it, and where its settings come from."""
    return settings_of(config) | {
        "profile": config["profile"],
        "training_images": data_facts["training_images"],
        "torch": torch.__version__,
    }


if __name__ == "__main__":
    main()
