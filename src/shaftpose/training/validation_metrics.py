"""The project's metrics on the validation images during training."""

import logging
import math
from pathlib import Path
from typing import Any

from lightning import Callback, LightningModule, Trainer

from shaftpose.core.instruments import Annotations, Detections, unpadded
from shaftpose.dataset.batches import Batch, Targets
from shaftpose.metrics.detection.precision_recall import best_confidence, precision_recall
from shaftpose.metrics.metrics import evaluate
from shaftpose.metrics.table import METRICS

logger = logging.getLogger(__name__)

LOGGED = [metric.name for metric in METRICS if metric.measure]
MERIT = "validation/mAP"


class ValidationMetrics(Callback):
    """Logs `validation/mAP` and so on at every validation, including one after the last step.

    `validation_step` must return `boxes`, `scores` and `poses` as `decode` does. The confidence
    threshold is the one with the best F1, as in the exported model.
    """

    def __init__(self) -> None:
        self._found: list[Detections] = []
        self._known: list[Annotations] = []

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        """Request a stop after the last step: Lightning then validates even if not due."""
        if trainer.global_step == trainer.max_steps:
            trainer.should_stop = True

    def on_validation_epoch_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Clear the results of the previous validation."""
        self._found, self._known = [], []

    def on_validation_batch_end(
        self,
        trainer: Trainer,
        pl_module: LightningModule,
        outputs: Any,
        batch: Batch,
        batch_idx: int,
        dataloader_idx: int = 0,
    ) -> None:
        """Keep the detections and annotations of a batch."""
        self._found += unpadded(**{name: t.double().cpu().numpy() for name, t in outputs.items()})
        self._known += annotations(batch.targets, batch.images.shape[1])

    def on_validation_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Log the metrics that have a value; pose errors have none if nothing was found."""
        confidence = best_confidence(precision_recall(self._found, self._known))
        metrics = evaluate(self._found, self._known, confidence)
        known = {name: value for name in LOGGED if (value := metrics[name]) is not None}
        # Each rank of a distributed training validates on all images: there is nothing to gather.
        for name, value in known.items():
            pl_module.log(
                f"validation/{name}", value,
                sync_dist=True, rank_zero_only=True, prog_bar=name == "mAP",
            )  # fmt: skip
        if trainer.sanity_checking or not trainer.is_global_zero:  # two batches tell nothing
            return
        shown = ", ".join(f"{name} {value:.3g}" for name, value in known.items())
        logger.info("step %d: %s", trainer.global_step, shown)


class BestWeights(Callback):
    """Keeps the weights with the best validation mAP in a file.

    It comes after `ValidationMetrics`. Averaged weights leave the module when a validation ends, so
    that Lightning's own callback, which comes later, would keep others than those validated.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._best = path, -math.inf

    def state_dict(self) -> dict[str, Any]:
        """The mAP of the weights in the file."""
        return {"best": self._best}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Go on from the mAP of a checkpoint."""
        self._best = state_dict["best"]

    def on_validation_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Write the weights if they are the best so far."""
        if trainer.sanity_checking:
            return
        # Of one rank: all must write together, but their values may differ in rounding.
        found = trainer.strategy.broadcast(float(trainer.callback_metrics[MERIT]))
        if found > self._best:
            self._best = found
            trainer.save_checkpoint(self._path, weights_only=True)


def annotations(targets: Targets, side_px: int) -> list[Annotations]:
    """The targets of a batch, image by image without padding, boxes in pixels."""
    boxes, poses = (values.double().cpu().numpy() for values in (targets.boxes, targets.poses))
    valid, has_pose = (values.cpu().numpy() for values in (targets.valid, targets.has_pose))
    return [
        Annotations(b[v] * side_px, p[v] if known else None)
        for b, p, v, known in zip(boxes, poses, valid, has_pose, strict=True)
    ]
