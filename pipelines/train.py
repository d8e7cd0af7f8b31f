"""Stage `train`: one variant, from lists of images to a checkpoint and learning curves."""

import csv
import logging
import tempfile
import uuid
from pathlib import Path
from typing import Any

import torch
from lightning import Trainer, seed_everything
from lightning.pytorch.callbacks import LearningRateMonitor, TQDMProgressBar
from lightning.pytorch.loggers import CSVLogger
from networks import build_network, identity, variant
from results import write_json
from settings import size
from stage import Config, stage
from validation import ValidationMetrics

from shaftpose import tracking
from shaftpose.config import Augmentation, LossSettings, Size, TrainingSettings, Variant, parse
from shaftpose.dataset.coco import read_coco
from shaftpose.dataset.split import read_keys
from shaftpose.dataset.training_data import (
    RealImages,
    RenderedImages,
    TrainingData,
    TrainingStream,
    Transform,
)
from shaftpose.dataset.transforms import ColourJitter, UniformNoise
from shaftpose.network.loss import ShaftLoss
from shaftpose.network.module import ShaftModule
from shaftpose.shards import ShardedDataset

logger = logging.getLogger(__name__)

# Lightning's remarks on hardware and its own products; progress and errors still show.
logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)


@stage
def main(config: Config) -> None:
    """Write `model.ckpt`, `curves.csv` and `training.json` to `out`."""
    chosen, sizes, out = variant(config), size(config), Path(config["out"])
    out.mkdir(parents=True, exist_ok=True)
    seed_everything(config["seed"], verbose=False)
    module, data = build_module(config, sizes), training_data(config, chosen, sizes)
    training_id = uuid.uuid4().hex
    tracking.connect(**config["tracking"])
    logger.info("training %s: %d steps of %d images", chosen.title, sizes.steps, sizes.batch_size)
    with (
        tracking.training_run(
            training_id,
            name=chosen.name,
            parameters=logged_parameters(config),
            dataset=tracking.dataset_identity(Path("dvc.lock")),
            sweep_folder=out.parent,
        ) as mlflow_logger,
        tempfile.TemporaryDirectory() as logs,
    ):
        curves = CSVLogger(logs, name="", version="")
        trainer = build_trainer(config, sizes, [curves, mlflow_logger])
        trainer.fit(module, data)
        curves.save()
        write_curves(Path(logs) / "metrics.csv", out / "curves.csv")
    trainer.save_checkpoint(out / "model.ckpt", weights_only=True)
    facts = {
        "training_id": training_id,
        "training_images": len(read_keys(Path("data/split"), "train")),
        "steps": trainer.global_step,
        "batch_size": sizes.batch_size,
        "width": sizes.width,
        "seed": config["seed"],
        "parameters": sum(weight.numel() for weight in module.network.parameters()),
    }
    write_json(out / "training.json", facts)
    logger.info("checkpoint and learning curves are in %s", out)


def build_module(config: Config, sizes: Size) -> ShaftModule:
    """The network with its loss and optimiser."""
    loss = parse(LossSettings, config["loss"], "params.yaml: loss")
    return ShaftModule(
        network=build_network(config),
        loss=ShaftLoss(loss.alpha, loss.beta, loss.gamma),
        identity=identity(config),
        learning_rate=sizes.learning_rate,
        total_steps=sizes.steps,
        warmup_steps=sizes.warmup_steps,
    )


def training_data(config: Config, chosen: Variant, sizes: Size) -> TrainingData:
    """The images of the run, augmented, with real ones mixed in if the variant asks for them."""
    settings = parse(TrainingSettings, config["training"], "params.yaml: training")
    shards, lists = ShardedDataset(Path("data/render/images")), Path("data/split")
    stream = TrainingStream(
        rendered=RenderedImages(shards, read_keys(lists, "train")),
        real=real_images(config["camera"]["size_px"]) if chosen.real_share > 0 else None,
        real_share=chosen.real_share,
        transforms=transforms(settings.augmentation, chosen.noise),
        length=sizes.steps * sizes.batch_size,
        seed=config["seed"],
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


def build_trainer(config: Config, sizes: Size, loggers: list[Any]) -> Trainer:
    """One pass over the stream, validated every so many steps and after the last."""
    return Trainer(
        **config["trainer"],
        precision=sizes.precision,
        max_epochs=1,
        max_steps=sizes.steps,
        val_check_interval=min(sizes.validate_every, sizes.steps),
        log_every_n_steps=min(25, sizes.steps),
        logger=loggers,
        callbacks=[
            TQDMProgressBar(refresh_rate=20),
            LearningRateMonitor("step"),
            ValidationMetrics(),
        ],
        enable_checkpointing=False,
        enable_model_summary=False,
    )


def write_curves(logged: Path, out: Path) -> None:
    """Lightning's wide table, most cells of which are empty, as rows of step, name, value."""
    with logged.open(newline="") as source, out.open("w", newline="") as target:
        rows = csv.writer(target, lineterminator="\n")
        rows.writerow(["step", "name", "value"])
        for row in csv.DictReader(source):
            names = [name for name in row if row[name] and name not in ("step", "epoch")]
            rows.writerows([row["step"], name, row[name]] for name in names)


def logged_parameters(config: Config) -> dict[str, Any]:
    """What of the configuration determines a training."""
    parts = ("profile", "seed", "size", "variant", "loss", "training", "poses", "split")
    return {part: config[part] for part in parts} | {"torch": torch.__version__}


if __name__ == "__main__":
    main()
