"""Records of evaluated trainings."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest
import torch

from shaftpose.core.errors import InputError
from shaftpose.evaluation.results import Evaluation, Silhouettes
from shaftpose.metrics.image_metrics import SilhouetteScore
from studies import evaluate_trainings
from studies import write_results_page as results_page
from tests.evaluations import TRAINING, accuracy, evaluation, with_real

EVALUATION = evaluation("D + noise + real", with_real("stand-in"), refined=accuracy(mAP=0.75))


def write_training(folder: Path, evaluated: Evaluation = EVALUATION) -> Path:
    """Write the folder of an evaluated training below `folder`."""
    trained = folder / "sweeps/0"
    trained.mkdir(parents=True)
    checkpoint = {"identity": {"variant": "d_noise_real"}, "state_dict": {}}
    torch.save(checkpoint, trained / "model.ckpt")
    (trained / "training.json").write_text(json.dumps(asdict(evaluated.training)))
    (trained / "evaluation.json").write_text(json.dumps(asdict(evaluated)))
    score = {"rendered/clear": SilhouetteScore(0.75, 0.25, 2, 4)}
    measured = Silhouettes(score, score if evaluated.refined else None)
    (trained / "silhouette.json").write_text(json.dumps(asdict(measured)))
    return trained


def edit(path: Path, **values: Any) -> None:
    """Change values of a JSON file."""
    path.write_text(json.dumps(json.loads(path.read_text()) | values))


def test_a_record_is_found_by_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    paths = evaluate_trainings.record(write_training(tmp_path))
    assert paths == [
        Path(f"reports/trainings/d_noise_real-7-01234567{end}.json") for end in ("", "-refined")
    ]
    record, fitted = results_page.records(tmp_path)
    assert (fitted.row.refined, fitted.row.metrics["mAP"]) == (True, 0.75)
    assert fitted.curves == []
    assert (record.row.variant, record.row.seeds, record.row.steps) == ("d_noise_real", (7,), 10)
    assert (record.row.width, record.row.depth) == (0.125, 0.25)
    assert (record.row.metrics["mAP"], record.row.mixed_in_images) == (0.5, 2)
    assert record.recipe == {**TRAINING.recipe, "detection": EVALUATION.detection}
    assert record.binned_errors == EVALUATION.raw.binned_errors
    assert record.found == EVALUATION.raw.found
    assert record.row.silhouettes["rendered/clear"]["iou"] == 0.25
    assert record.curves == [(1, "validation/mAP", 0.1), (2, "validation/mAP", 0.25)]


def test_a_training_without_its_settings_is_refused(tmp_path: Path) -> None:
    folder = write_training(tmp_path)
    content = json.loads((folder / "training.json").read_text())
    del content["recipe"]
    (folder / "training.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match=r"training\.json: of another version.*recipe: .*; run"):
        evaluate_trainings.check(folder, TRAINING.data.digest)


def test_a_training_on_other_images_is_refused(tmp_path: Path) -> None:
    folder = write_training(tmp_path)
    evaluate_trainings.check(folder, TRAINING.data.digest)
    with pytest.raises(InputError, match="sweeps/0: was trained on other images than those in"):
        evaluate_trainings.check(folder, "fedcba9876543210")


def test_an_unfinished_training_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"training\.json: missing; run the training, or its"):
        evaluate_trainings.check(tmp_path, TRAINING.data.digest)
