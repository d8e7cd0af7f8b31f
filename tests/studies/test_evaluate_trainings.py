"""Records of evaluated trainings."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from shaftpose.errors import InputError
from shaftpose.evaluation.binned_errors import as_plain, binned_errors
from shaftpose.evaluation.common_instruments import found_instruments
from shaftpose.evaluation.pose_errors import errors_between
from shaftpose.settings.parts import PoseRanges
from studies import evaluate_trainings
from studies import write_results_page as results_page

POSES = np.array([[0.0, 0.0, 20.0, 70.0, 100.0]])
RANGES = PoseRanges(
    x_mm=(-20, 20), y_mm=(-20, 20), z_mm=(10, 40), pitch_deg=(50, 90), yaw_deg=(0, 358)
)
BINNED = binned_errors(errors_between(POSES + 1, POSES), np.ones(1), RANGES)
FOUND = found_instruments(errors_between(POSES + 1, POSES), 3)
TRAINING: dict[str, Any] = {
    "training_id": "0123456789abcdef", "training_images": 90, "skipped_images": 0, "steps": 10,
    "batch_size": 4, "width": 0.125, "depth": 0.25, "seed": 7, "parameters": 1000,
    "recipe": {"loss": {"alpha": 0.5}, "size": {"optimizer": "muon", "detector_steps": 5}},
    "variant": {"noise": 10, "start": True}, "data": "0123456789abcdef",
    "real": {"domain": "stand-in", "images": 2, "digest": "fedcba9876543210"},
}  # fmt: skip


def write_training(folder: Path, training: dict[str, Any]) -> Path:
    """Write the folder of an evaluated training below `folder`."""
    trained = folder / "sweeps/0"
    trained.mkdir(parents=True)
    checkpoint = {"identity": {"variant": "d_noise_real"}, "state_dict": {}}
    torch.save(checkpoint, trained / "model.ckpt")
    (trained / "training.json").write_text(json.dumps(training))
    evaluation = {
        "title": "D + noise + real", "training": training,
        "metrics": {"mAP": 0.5, "images": 20}, "binned_errors": as_plain(BINNED),
        "found": asdict(FOUND), "detection": {"overlap": 0.45},
        "fitted": {"metrics": {"mAP": 0.75, "images": 20}},
        "curves": [[9, "training/box", 1.0], [9, "validation/mAP", 0.25]],
    }  # fmt: skip
    (trained / "evaluation.json").write_text(json.dumps(evaluation))
    return trained


def test_a_record_is_found_by_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    paths = evaluate_trainings.record(write_training(tmp_path, TRAINING))
    assert paths == [
        Path(f"reports/trainings/{name}-7-01234567.json")
        for name in ("d_noise_real", "d_noise_real_fitted")
    ]
    record, fitted = results_page.records(tmp_path)
    assert (fitted.row.title, fitted.row.metrics["mAP"]) == ("D + noise + real + fit", 0.75)
    assert fitted.curves == []
    assert (record.row.variant, record.row.seeds, record.row.steps) == ("d_noise_real", (7,), 10)
    assert (record.row.width, record.row.depth) == (0.125, 0.25)
    assert (record.row.metrics["mAP"], record.row.mixed_in_images) == (0.5, 2)
    assert record.recipe == {**TRAINING["recipe"], "detection": {"overlap": 0.45}}
    assert record.binned_errors == BINNED
    assert record.found == FOUND
    assert record.curves == [(9, "validation/mAP", 0.25)]


def test_a_training_without_its_settings_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    training = {key: value for key, value in TRAINING.items() if key != "recipe"}
    with pytest.raises(InputError, match=r"training\.json: of another version.*'recipe'"):
        evaluate_trainings.check(write_training(tmp_path, training), TRAINING["data"])


def test_a_training_on_other_images_is_refused(tmp_path: Path) -> None:
    folder = write_training(tmp_path, TRAINING)
    evaluate_trainings.check(folder, TRAINING["data"])
    with pytest.raises(InputError, match="sweeps/0: was trained on other images than those in"):
        evaluate_trainings.check(folder, "fedcba9876543210")


def test_an_unfinished_training_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"training\.json: missing; run the training, or its"):
        evaluate_trainings.check(tmp_path, TRAINING["data"])
