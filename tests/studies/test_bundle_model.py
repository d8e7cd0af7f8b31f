"""Bundling of a finished training's model with the package."""

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import ModelProto, numpy_helper

from shaftpose.core.errors import InputError
from shaftpose.inference import model_files
from shaftpose.inference.model_files import bundled_model
from shaftpose.inference.predictor import Predictor
from studies import bundle_model
from studies.model_frames import complaints
from tests.conftest import BOXES
from tests.evaluations import TRAINING, accuracy
from tests.studies.conftest import SHAFT, comparison
from tests.studies.test_evaluate_trainings import edit


def bundle(training: Path) -> Path:
    """Bundle the training's model below a root; returns the root."""
    root = training.parents[1] / "root"
    bundle_model.bundle(training, training, root)
    return root


def test_all_that_belongs_to_a_model_is_written(
    training: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = bundle(training)
    models, frames = root / "src/shaftpose/models", root / "tests/data/bundled_models/shaftpose"
    assert {path.name for path in models.iterdir()} == {
        "shaftpose.onnx", "shaftpose.onnx.sha256", "shaftpose.md",
    }  # fmt: skip
    monkeypatch.setattr(model_files, "FOLDER", models)
    predictor = Predictor(bundled_model())
    assert (predictor.confidence, predictor.metadata.shaft_diameter_mm) == (0.5, 3.0)
    content = json.loads((frames / "frames.json").read_text())
    names = ["frame_0.jpg", "frame_1.jpg", "frame_2.jpg"]
    assert [frame["image"] for frame in content["frames"]] == names
    assert all((frames / name).is_file() for name in names)
    assert content["frames"][0]["boxes"] == BOXES[:1]  # without the first image, which has no shaft
    assert content["frames"][0]["poses"] == [SHAFT.as_array().tolist()]
    assert (content["found"], content["bounds"]["tip_mm"]) == (3, 0.65)  # 1.1 x 0.5 mm + 0.1
    assert complaints(predictor, frames) == []


def test_the_project_keeps_its_mode_and_old_frames_go(training: Path) -> None:
    root = training.parents[1] / "root"
    old = root / "tests/data/bundled_models/shaftpose/frame_7.jpg"
    old.parent.mkdir(parents=True)
    old.touch()
    root.chmod(0o755)
    bundle(training)
    assert root.stat().st_mode & 0o777 == 0o755
    assert not old.exists()


def test_the_card_states_what_the_files_do(training: Path) -> None:
    card = (bundle(training) / "src/shaftpose/models/shaftpose.md").read_text()
    for stated in (
        "90, rendered; shafts in front of procedural tissue",
        "2 (stand-in) without poses",
        "view angle 95 deg", "diameter 3 mm", "x -20 to 20 mm, pitch 50 to 90 deg",
        "D + noise + real, width 0.125, depth 0.25, 1,000 parameters",
        "`0123456789abcdef`, seed 7: after 5 steps of a detector without poses, 10 steps",
        "5 rendered test images with 4 shafts", "at least 0.500",
        "| bundled | 0.800 | 1.000 | 0.50 | 0.00 | 0.00 | 0.00 | 0.00 | 0.00 | 0.50 |",
        "100.00 % of the exported model's detections are shared, the mAP changes by +0.00000",
        "research use only", "Apache-2.0",
    ):  # fmt: skip
        assert stated in card


def test_a_model_of_real_images_names_its_encoder_and_whose_they_are(training: Path) -> None:
    path = training / "evaluation.json"
    result = json.loads(path.read_text())
    result["training"]["data"]["mixed_in"]["domain"] = "real"
    result["training"]["variant"]["network"]["encoder"] = "lite0"
    result["training"]["variant"]["average_share"] = 0.5
    path.write_text(json.dumps(result))
    root = training.parents[1] / "root"
    bundle_model.bundle(training, training, root, "other", "Frames: somebody, MIT")
    card = (root / "src/shaftpose/models/other.md").read_text()
    assert card.startswith("# Model card: other\n")
    assert "with `--model other`" in card
    assert "EfficientNet-lite0 has learned on ImageNet" in card
    assert "averaged with those after them; share of the latter: 0.5\n" in card
    assert "docs/real_images.md" in card and "Real images were not measured" not in card
    assert card.endswith("Origins of the real images:\n\nFrames: somebody, MIT\n")


def refused(training: Path, message: str) -> None:
    """Check that the training is refused and nothing is written."""
    with pytest.raises(InputError, match=message):
        bundle(training)
    assert not (training.parents[1] / "root").exists()


def test_a_training_without_results_is_refused(training: Path) -> None:
    (training / "evaluation.json").unlink()
    refused(training, r"evaluation\.json: missing; run `python -m studies.evaluate_trainings")


def test_results_of_another_training_are_refused(training: Path) -> None:
    edit(training / "evaluation.json", training=asdict(replace(TRAINING, training_id="fedc")))
    refused(training, r"evaluation\.json: belongs to another training than")


def test_results_of_another_model_are_refused(training: Path) -> None:
    edit(training / "evaluation.json", raw=asdict(accuracy(mAP=0.81)))
    refused(training, r"model\.onnx: has a mAP of 0\.800, but 0\.810 was recorded")


def test_a_model_that_is_too_large_is_refused(
    training: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bundle_model, "MOST_BYTES", 500)
    refused(training, r"shaftpose\.onnx: take [\d,]+ bytes .*, more than the limit of 500; bundle")


def moved(model: ModelProto) -> ModelProto:
    """A model whose poses have an error of 2 mm in x."""
    offset = np.array([2, 0, 0, 0, 0], np.float32)
    copy = ModelProto()
    copy.CopyFrom(model)
    (poses,) = (value for value in copy.graph.initializer if value.name == "poses of one")
    poses.CopyFrom(numpy_helper.from_array(numpy_helper.to_array(poses) + offset, poses.name))
    return copy


def test_a_model_that_storing_damages_is_refused(
    training: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bundle_model, "with_half_weights", moved)
    refused(training, r"loses too much in 16 bits: .*x_mm 2\.0000.*; x_mm is 1\.500, above 0\.65")


def test_bounds_are_broken_by_worse_poses_and_by_missed_shafts(training: Path) -> None:
    frames, file = bundle(training) / "tests/data/bundled_models/shaftpose", training / "model.onnx"
    exported = onnx.load(str(file))
    onnx.save(moved(exported), str(file))
    worse = [f"{name} is 1.500, above 0.65" for name in ("x_mm", "tip_mm")]
    assert complaints(Predictor(file), frames) == worse
    for value in exported.graph.initializer:
        if value.name == "scores of one":
            value.CopyFrom(numpy_helper.from_array(np.zeros((1, 3), np.float32), value.name))
    onnx.save(exported, str(file))
    assert complaints(Predictor(file), frames) == ["finds 0 instruments, not 3"]


def test_a_comparison_holds_within_its_limits() -> None:
    assert comparison().holds
    assert not comparison(shared=0.94).holds
    assert not comparison(growth={"tip_mm": 0.04, "axis_deg": 0.0}).holds
    assert not comparison(growth={"tip_mm": -0.1, "axis_deg": 0.04}).holds
    nothing = float("nan")  # errors of 0
    assert comparison(growth={"tip_mm": nothing, "axis_deg": nothing}).holds
    assert not comparison(stored={**comparison().exported, "mAP": 0.894}).holds
    assert not comparison(shared=0.0).holds
