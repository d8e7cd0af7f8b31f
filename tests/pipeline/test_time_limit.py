"""A training that reaches its time limit leaves a complete result."""

import csv
from pathlib import Path

import pytest
import torch

from tests.pipeline.conftest import settings_with
from tests.pipeline.test_finished import run_stage
from tests.pipeline.test_resume import SELDOM, SIZES, STEP, STEPS, Killed, Training

OVER_AT_ONCE = "training.max_hours=1e-9"


def test_a_training_without_time_takes_a_step_and_is_validated(
    inside: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    record = run_stage(settings_with(*SIZES, OVER_AT_ONCE, f"out={tmp_path}"))
    assert record["steps"] == 1 < STEPS
    checkpoint = torch.load(tmp_path / "model.ckpt", weights_only=True)
    assert checkpoint["global_step"] == 1
    with (tmp_path / "curves.csv").open(newline="") as stream:
        names = {row["name"] for row in csv.DictReader(stream)}
    assert {"train/loss", "validation/loss", "validation/mAP"} <= names


def test_the_time_before_an_interruption_counts(inside: Path, tmp_path: Path) -> None:
    with pytest.raises(Killed):
        Training(tmp_path, (SELDOM,), (STEP, 4))
    last = tmp_path / "last.ckpt"
    checkpoint = torch.load(last, weights_only=True)
    time_elapsed = checkpoint["callbacks"]["TimeLimit"]["time_elapsed"]
    assert 0 < time_elapsed["train"] < 3600
    time_elapsed["train"] = 7200.0
    torch.save(checkpoint, last)
    resumed = Training(tmp_path, (SELDOM, "training.max_hours=1"))
    assert list(resumed.watched.drawn) == [3]
    assert resumed.trainer.global_step == 4
    curves = {(step, name): value for step, name, value in resumed.curves.rows}
    assert (3, "validation/mAP") in curves
    # The schedule is that of all steps; the second group of weights has the unscaled learning rate.
    assert resumed.module.total_steps == STEPS
    rate = resumed.module.learning_rate * resumed.module.learning_rate_factor(3)
    assert curves[3, "train/learning_rate/pg2"] == pytest.approx(rate)
