"""Values and steps of the validation log, with made-up detections instead of a network."""

import random
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
import torch
from lightning import LightningModule
from torch import Tensor
from torch.utils.data import DataLoader

from shaftpose.core.instruments import Annotations, Detections
from shaftpose.dataset.batches import Batch, pad_batch
from shaftpose.metrics.metrics import evaluate
from shaftpose.metrics.table import MetricValues
from shaftpose.training.assembly import build_trainer
from shaftpose.training.curves import Curves
from shaftpose.training.validation_metrics import LOGGED, ValidationMetrics, annotations
from tests.pipeline.conftest import recipe_with

SIDE = 299
BOX, OTHER_BOX = [20.0, 30.0, 120.0, 200.0], [150.0, 10.0, 290.0, 90.0]
POSE, OTHER_POSE = [1.0, -2.0, 20.0, 70.0, 123.0], [-8.0, 5.0, 31.0, 55.0, 350.0]
NEAR_POSE = [2.0, -2.5, 23.0, 74.0, 118.0]


def known(boxes: list[list[float]], poses: list[list[float]]) -> Annotations:
    return Annotations(np.array(boxes), np.array(poses))


def found(boxes: list[list[float]], scores: list[float], poses: list[list[float]]) -> Detections:
    return Detections(np.array(boxes), np.array(scores), np.array(poses))


# Five images in three batches; Lightning's sanity check before the training takes two of these.
BATCH = 2
KNOWN = [
    known([BOX, OTHER_BOX], [POSE, OTHER_POSE]),
    known([BOX], [POSE]),
    known([OTHER_BOX], [OTHER_POSE]),
    known([BOX], [POSE]),
    known([BOX], [POSE]),
]
FOUND = [
    found([BOX], [0.9], [NEAR_POSE]),  # one of two
    found([BOX], [0.75], [OTHER_POSE]),
    found([BOX, OTHER_BOX], [0.625, 0.375], [POSE, OTHER_POSE]),  # a false alarm of low score
    found([OTHER_BOX], [0.8], [POSE]),  # a false alarm
    found([BOX], [0.7], [POSE]),
]
UNSURE = [Detections(f.boxes, f.scores / 2, f.poses) for f in FOUND]
WRONG = [Detections(f.boxes - 1000, f.scores, f.poses) for f in FOUND]


def padded(detections: Sequence[Detections], places: int = 4) -> dict[str, Tensor]:
    """Detections as a network decodes them: a batch of `places` each, padded with zeros."""
    outputs = {
        "boxes": torch.zeros(len(detections), places, 4),
        "scores": torch.zeros(len(detections), places),
        "poses": torch.zeros(len(detections), places, 5),
    }
    for n, image in enumerate(detections):
        for name, values in outputs.items():
            rows = torch.from_numpy(getattr(image, name))
            values[n, : len(rows)] = rows
    return outputs


class Oracle(LightningModule):
    """Returns made-up detections for the validation images, batch by batch."""

    def __init__(self, answers: list[dict[str, Tensor]]) -> None:
        super().__init__()
        self.weight = torch.nn.Parameter(torch.zeros(()))
        self.answers = answers

    def training_step(self, batch: Batch, batch_index: int) -> Tensor:
        return self.weight**2

    def validation_step(self, batch: Batch, batch_index: int) -> dict[str, Tensor]:
        self.log("validation/weight", self.weight, batch_size=len(batch.images))
        return self.answers[batch_index]

    def configure_optimizers(self) -> torch.optim.Optimizer:
        return torch.optim.SGD(self.parameters(), lr=0.1)


def loader(images: Sequence[Annotations]) -> DataLoader[Any]:
    items = [(np.zeros((SIDE, SIDE, 3), np.uint8), image) for image in images]
    return DataLoader(items, batch_size=BATCH, collate_fn=pad_batch)  # type: ignore[arg-type]


def curves(
    folder: Path, detections: Sequence[Detections], steps: int, validate_every: int
) -> dict[int, dict[str, float]]:
    """Step -> metrics logged by its validation, in a training of `steps`."""
    recipe = recipe_with(
        "profile=smoke", "trainer=cpu", "profiles.smoke.warmup_steps=0",
        f"profiles.smoke.steps={steps}", f"profiles.smoke.validate_every={validate_every}",
    )  # fmt: skip
    answers = [padded(detections[n : n + BATCH]) for n in range(0, len(KNOWN), BATCH)]
    rows = Curves()
    trainer = build_trainer(recipe, folder, rows)
    trainer.fit(Oracle(answers), loader(KNOWN[:1] * BATCH * steps), loader(KNOWN))
    assert trainer.global_step == steps
    logged: dict[int, dict[str, float]] = {}
    for step, name, value in rows.rows:
        phase, _, metric = name.partition("/")
        if phase == "validation":
            values = logged.setdefault(step, {})
            assert metric not in values, "validated twice"
            values[metric] = value
    return logged


def expected(metrics: MetricValues) -> dict[str, float]:
    values = {name: metrics[name] for name in LOGGED}
    return {name: value for name, value in values.items() if value is not None}


def test_logged_are_the_metrics_of_the_whole_validation_set(tmp_path: Path) -> None:
    # Best score first: right, wrong, right, right, wrong, right. With six instruments F1 is 2/7,
    # 2/8, 4/9, 6/10, 6/11 and 8/12: all six detections count.
    metrics = evaluate(FOUND, KNOWN, confidence=0.375)
    assert metrics["detected_rate"] == pytest.approx(4 / 6)
    assert metrics["yaw_deg"] == pytest.approx((5 + 133 + 0 + 0) / 4)
    logged = curves(tmp_path, FOUND, steps=1, validate_every=1)[0]
    assert logged.pop("weight") == 0.0
    assert set(logged) == {
        "mAP", "detected_rate", "x_mm", "y_mm", "z_mm", "pitch_deg", "yaw_deg", "axis_deg", "tip_mm"
    }  # fmt: skip
    assert logged == pytest.approx(expected(metrics))


def test_low_scores_alone_do_not_hide_what_was_learned(tmp_path: Path) -> None:
    logged = curves(tmp_path, UNSURE, steps=1, validate_every=1)[0]
    assert logged.pop("weight") == 0.0
    assert logged == pytest.approx(expected(evaluate(FOUND, KNOWN, confidence=0.375)))


def test_without_a_right_detection_there_are_no_pose_errors(tmp_path: Path) -> None:
    logged = curves(tmp_path, WRONG, steps=1, validate_every=1)[0]
    assert logged == {"weight": 0.0, "mAP": 0.0, "detected_rate": 0.0}


@pytest.mark.parametrize(
    ("steps", "validate_every", "validated"),
    [
        (4, 2, [1, 3]),  # due at the last step: once
        (5, 2, [1, 3, 4]),  # not due
        (3, 10, [2]),  # shorter than the interval
    ],
)
def test_the_last_step_is_validated_once(
    tmp_path: Path, steps: int, validate_every: int, validated: list[int]
) -> None:
    logged = curves(tmp_path, FOUND, steps, validate_every)
    assert sorted(logged) == validated
    assert all("mAP" in values for values in logged.values())


def test_measuring_draws_no_random_number_and_changes_no_output() -> None:
    """So weights do not depend on metrics."""
    metrics, trainer, module = ValidationMetrics(), Mock(global_step=1), Mock()
    module.network.side_px = SIDE
    outputs, batch = padded(FOUND[:BATCH]), next(iter(loader(KNOWN)))
    before = {name: values.clone() for name, values in outputs.items()}
    states = torch.get_rng_state(), np.random.get_state()[1], random.getstate()
    metrics.on_validation_epoch_start(trainer, module)
    metrics.on_validation_batch_end(trainer, module, outputs, batch, 0)
    metrics.on_validation_epoch_end(trainer, module)
    module.log.assert_called()
    assert torch.equal(torch.get_rng_state(), states[0])
    assert np.array_equal(np.random.get_state()[1], states[1])
    assert random.getstate() == states[2]
    assert all(torch.equal(outputs[name], values) for name, values in before.items())


def test_images_without_poses_have_none() -> None:
    rgb = np.zeros((SIDE, SIDE, 3), np.uint8)
    items = [(rgb, KNOWN[0]), (rgb, Annotations(np.array([BOX]), None))]
    both, boxes_alone = annotations(pad_batch(items).targets, SIDE)
    np.testing.assert_allclose(both.boxes, KNOWN[0].boxes, rtol=1e-6)
    np.testing.assert_allclose(both.poses, KNOWN[0].poses, rtol=1e-6)
    np.testing.assert_allclose(boxes_alone.boxes, [BOX], rtol=1e-6)
    assert boxes_alone.poses is None
