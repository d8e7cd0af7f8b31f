"""The evaluation of a training, in miniature."""

from dataclasses import replace
from typing import Any

import numpy as np

from shaftpose.evaluation.results import Accuracy, Evaluation
from shaftpose.metrics.binned_errors import binned_errors
from shaftpose.metrics.pose_errors import errors_between, found_instruments
from shaftpose.metrics.table import MetricValues
from shaftpose.settings.schema import PoseRanges
from shaftpose.stage_files import DataRecord, MixedInImages, TrainingRecord

RANGES = PoseRanges(
    x_mm=(-20, 20), y_mm=(-20, 20), z_mm=(10, 40), pitch_deg=(50, 90), yaw_deg=(0, 358)
)
POSES = np.array([[0.0, 0.0, 20.0, 70.0, 100.0]])
ERRORS = errors_between(POSES + 1, POSES)
METRICS: MetricValues = {
    "mAP": 0.5, "detected_rate": 0.5, **ERRORS.means(), "images": 20, "instruments": 3,
    "detections": 1, "confidence": 0.5,
}  # fmt: skip
SIZE = {
    "optimizer": "muon",
    "precision": "32-true",
    "detector_steps": 5,
    "batch_size": 4,
    "width": 0.125,
    "depth": 0.25,
}
TRAINING = TrainingRecord(
    training_id="0123456789abcdef",
    fingerprint="0011223344556677",
    seed=7,
    data=DataRecord("aabb", 90, "0123456789abcdef", None),
    variant={"network": {"backbone": {}}, "noise": 10, "start": True},
    recipe={"loss": {"alpha": 0.5}, "size": SIZE},
    skipped_images=0,
    steps=10,
    parameters=1000,
)


def with_real(domain: str) -> TrainingRecord:
    """The training with two images of the domain mixed in."""
    mixed_in = MixedInImages(domain, 2, "fedcba9876543210")
    return replace(TRAINING, data=replace(TRAINING.data, mixed_in=mixed_in))


def accuracy(**metrics: Any) -> Accuracy:
    """One of three instruments, found 1 mm and 1 deg off, with the given metrics."""
    return Accuracy(
        metrics={**METRICS, **metrics},
        binned_errors=binned_errors(ERRORS, np.ones(1), np.ones(1), RANGES.low, RANGES.high),
        found=found_instruments(ERRORS, 3),
        precision_recall={"recall": [0.5], "precision": [1.0], "scores": [0.9]},
    )


def evaluation(title: str, training: TrainingRecord = TRAINING, **changed: Any) -> Evaluation:
    """An evaluation, by default without refined poses."""
    return Evaluation(
        title=title,
        training=training,
        detection={"nms_iou": 0.45, "refine": "edges"},
        raw=changed.pop("raw", accuracy()),
        refined=changed.pop("refined", None),
        validation={**METRICS, "mAP": 0.2, "tip_mm": None},
        curves=[(1, "train/box", 1.0), (1, "validation/mAP", 0.1), (2, "validation/mAP", 0.25)],
    )
