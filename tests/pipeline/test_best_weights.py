"""The weights with the best validation mAP as result, and the end of trainings without progress."""

from collections.abc import Iterator
from pathlib import Path

import pytest
import torch

from shaftpose.training import validation_metrics
from tests.pipeline.conftest import recipe_with
from tests.pipeline.test_resume import SELDOM, STEP, Killed, Training

EACH_STEP = (SELDOM, "profiles.smoke.validate_every=1", "profiles.smoke.steps=5")
METRICS = dict.fromkeys(validation_metrics.LOGGED)


@pytest.fixture
def measured(inside: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """mAP of each validation, after Lightning's check of the validation images: 0.1, 0.5, ..."""
    values: Iterator[float] = iter((0.0, 0.1, 0.5, 0.3, 0.4))
    monkeypatch.setattr(
        validation_metrics, "evaluate", lambda *arguments: METRICS | {"mAP": next(values, 0.2)}
    )


def step_of(folder: Path) -> int:
    return int(torch.load(folder / "model.ckpt", weights_only=True)["global_step"])


@pytest.mark.usefixtures("measured")
def test_the_best_weights_are_kept_over_an_interruption(tmp_path: Path) -> None:
    overrides = (*EACH_STEP, "training.keep_best=true")
    with pytest.raises(Killed):
        Training(tmp_path, overrides, (STEP, 3))
    resumed = Training(tmp_path, overrides)
    assert resumed.trainer.global_step == 5
    assert step_of(tmp_path) == 2
    Training(tmp_path, overrides)  # after a failure behind the last step
    assert step_of(tmp_path) == 2


@pytest.mark.usefixtures("measured")
def test_averaged_weights_are_kept_as_they_were_validated(tmp_path: Path) -> None:
    options = ("training.keep_best=true", "training.ema_decay=0.5")
    two_steps = ("profiles.smoke.steps=2", "profiles.smoke.warmup_steps=1")  # the best is the last
    ended = Training(tmp_path, (*EACH_STEP, *options, *two_steps))
    kept = torch.load(tmp_path / "model.ckpt", weights_only=True)["state_dict"]
    for name, value in ended.weights.items():
        assert torch.equal(kept[f"network.{name}"], value), name


@pytest.mark.usefixtures("measured")
def test_the_last_weights_are_kept_without_being_asked(tmp_path: Path) -> None:
    Training(tmp_path, EACH_STEP)
    assert step_of(tmp_path) == 5


@pytest.mark.usefixtures("measured")
def test_validations_without_progress_end_a_training(tmp_path: Path) -> None:
    overrides = (*EACH_STEP, "training.patience=2", "training.keep_best=true")
    ended = Training(tmp_path, overrides)
    assert ended.trainer.global_step == 4
    assert Training(tmp_path, overrides).trainer.global_step == 4  # after a failure behind its end
    assert [step for step, name, _ in ended.curves.rows if name == "validation/mAP"] == [0, 1, 2, 3]
    assert step_of(tmp_path) == 2


def test_options_that_are_off_leave_older_trainings_comparable() -> None:
    off, on = recipe_with(), recipe_with("training.patience=3")
    assert not {"patience", "keep_best"} & off.comparison_key()["training"].keys()
    assert on.comparison_key()["training"]["patience"] == 3
    assert on.fingerprint_fields() != off.fingerprint_fields()
