"""Settings where they take effect: in the network's training, its images and its threshold."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from shaftpose.dataset.skipped import SkippedImages
from shaftpose.dataset.split import read_keys
from shaftpose.dataset.training_data import TrainingData, TrainingStream
from shaftpose.dataset.transforms import ColourJitter, UniformNoise
from shaftpose.errors import InputError
from shaftpose.instruments import Detections
from shaftpose.shards import ShardedDataset
from tests.pipeline.conftest import ROOT
from tests.pipeline.small_data import write_training_data
from tests.pipeline.test_configs import composed

sys.path.insert(0, str(ROOT / "pipelines"))

import export  # noqa: E402
import networks  # noqa: E402
import predictions  # noqa: E402
import settings  # noqa: E402
import train  # noqa: E402

POSES = ("head.pose", "pose_coder.")
JITTER = {"brightness": [1, 2], "contrast": [3, 4], "saturation": [5, 6], "hue_deg": [7, 8]}


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder in which everything here runs."""
    write_training_data(tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def training_data(folder: Path, *overrides: str) -> TrainingData:
    config = composed("profile=smoke", "training.loader_workers=0", *overrides)
    sizes, skipped = settings.size(config), SkippedImages(folder / "skipped")
    return train.training_data(config, networks.variant(config), sizes, skipped)


def stream(data: TrainingData) -> TrainingStream:
    images = data.train_dataloader().dataset
    assert isinstance(images, TrainingStream)
    return images


def test_the_optimiser_follows_the_profile() -> None:
    sizes = (
        "steps=40", "detector_steps=30", "warmup_steps=5", "learning_rate=0.003", "optimizer=adam",
    )  # fmt: skip
    config = composed("profile=smoke", *(f"profiles.smoke.{size}" for size in sizes),
                      "training.frozen_norm_share=0.25", "variant.start=null")  # fmt: skip
    module = train.build_module(config, settings.size(config))
    assert (module.learning_rate, module.total_steps, module.warmup_steps) == (0.003, 40, 5)
    assert module.optimizer == "adam"
    assert module.frozen_norm_from == 30
    assert module.identity == {"variant": "d", "width": 0.1875, "depth": 0.25}


def test_a_detector_takes_its_own_steps_and_no_pose_loss() -> None:
    sizes = ("steps=40", "detector_steps=30")
    overrides = "profile=smoke", *(f"profiles.smoke.{size}" for size in sizes)
    config = train.with_detector_settings(composed("variant=detector", *overrides))
    module = train.build_module(config, settings.size(config))
    assert module.total_steps == 30
    assert module.loss.beta.tolist() == [0.0] * 5
    other = composed("variant=d", *overrides)
    assert train.with_detector_settings(other) == other


def test_a_variant_starts_from_the_detectors_weights(folder: Path, tmp_path: Path) -> None:
    """Backbone, classes and boxes; its poses are its own. B has other buffers for them."""
    alone = composed("profile=smoke", "variant=detector")
    detector = train.build_module(alone, settings.size(alone))
    path = tmp_path / "model.ckpt"
    state = {f"network.{name}": value + 1 for name, value in detector.network.state_dict().items()}
    torch.save({"state_dict": state, "identity": detector.identity}, path)
    for variant in ("b", "c", "d"):
        config = composed("profile=smoke", f"variant={variant}", f"variant.start={path}")
        weights = networks.initial_network(config).state_dict()
        learned = {name for name in weights if not name.startswith(POSES)}
        assert learned == {n for n in detector.network.state_dict() if not n.startswith(POSES)}
        assert all(torch.equal(weights[name], state[f"network.{name}"]) for name in learned)
    deeper = composed("profile=smoke", f"variant.start={path}", "profiles.smoke.depth=0.5")
    with pytest.raises(InputError, match=r"'depth': 0.25}, not of .*'depth': 0.5}.*start=null"):
        networks.initial_network(deeper)
    state.pop("network.head.box_convs.0.bias")
    torch.save({"state_dict": state, "identity": detector.identity}, path)
    with pytest.raises(InputError, match=r"head.box_convs.0.bias is not in both networks"):
        networks.initial_network(composed("profile=smoke", f"variant.start={path}"))


@pytest.mark.parametrize(
    ("variant", "noise", "real"),
    [("c", 0, 0), ("d", 0, 0), ("d_noise", 10, 0), ("d_noise_real", 10, 2)],
)
def test_a_variant_has_the_noise_and_the_real_images_of_its_file(
    variant: str, noise: int, real: int, folder: Path
) -> None:
    images = stream(training_data(folder, f"variant={variant}"))
    jitter, *others = images.transforms
    assert isinstance(jitter, ColourJitter)
    assert others == ([UniformNoise(noise)] if noise else [])
    assert images.real_share == (pytest.approx(2 / 11) if real else 0)
    assert (len(images.real) if images.real is not None else 0) == real


def test_colours_change_as_the_settings_say(folder: Path) -> None:
    ranges = [f"training.augmentation.{key}={values}" for key, values in JITTER.items()]
    (jitter,) = stream(training_data(folder, *ranges)).transforms
    assert jitter == ColourJitter((1, 2), (3, 4), (5, 6), (7, 8))


def test_symmetries_change_images_and_boxes_alike(folder: Path) -> None:
    """The bars of these images lie in their boxes, wherever the images are turned to."""
    plain = stream(training_data(folder))
    turned = stream(training_data(folder, "training.augmentation.symmetries=true"))
    changed = 0
    for n in range(8):
        (rgb, known), (before, _) = turned[n], plain[n]
        assert np.array_equal(rgb, turned[n][0])
        changed += not np.array_equal(rgb, before)
        for x0, y0, x1, y1 in known.boxes.astype(int):
            assert rgb[y0:y1, x0:x1].mean() > rgb.mean() + 20
    assert changed > 4


def test_each_part_of_the_split_has_its_use(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No network, and no threshold of one, has seen a test image."""
    data, lists = training_data(folder), folder / "data/split"
    rendered: Any = stream(data).rendered
    validation: Any = data.val_dataloader().dataset
    assert rendered.keys == read_keys(lists, "train")
    assert validation.keys == read_keys(lists, "validation")
    seen: list[str] = []
    image = np.zeros((299, 299, 3), dtype=np.uint8)
    monkeypatch.setattr(ShardedDataset, "rgb", lambda _, key: seen.append(key) or image)
    export.validated_confidence(Blind())  # type: ignore[arg-type]
    assert seen == read_keys(lists, "validation")
    seen.clear()
    export.test_images(1)
    assert seen == read_keys(lists, "test")[:1]


class Blind:
    """A predictor that finds nothing."""

    confidence = 0.37

    def __call__(self, images: np.ndarray) -> list[Detections]:
        """Nothing, for each image."""
        return [Detections(np.empty((0, 4)), np.empty(0), np.empty((0, 5))) for _ in images]


@pytest.mark.parametrize(("chosen", "counts_from"), [("null", 0.37), ("0", 0.0), ("0.8", 0.8)])
def test_detections_count_from_the_score_of_the_user_or_of_the_model(
    chosen: str, counts_from: float
) -> None:
    config = composed("profile=smoke", f"detection.confidence={chosen}")
    assert predictions.least_confidence(config, Blind()) == counts_from  # type: ignore[arg-type]
