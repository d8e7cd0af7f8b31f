"""Settings take effect in the network's training, its images and its confidence threshold."""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from shaftpose.core.errors import InputError
from shaftpose.core.instruments import Detections
from shaftpose.core.shards import ShardedDataset
from shaftpose.dataset.colour_transforms import ColourJitter, UniformNoise
from shaftpose.dataset.labelled_images import ImagesInMemory
from shaftpose.dataset.split import first_images, read_keys
from shaftpose.dataset.training_data import TrainingData
from shaftpose.dataset.training_stream import SkippedImages, TrainingStream
from shaftpose.export.checked_export import validated_confidence
from shaftpose.inference.shard_prediction import confidence_threshold
from shaftpose.network.building import initial_network
from shaftpose.network.pose_network import PoseNetwork
from shaftpose.network.ssd.single_shot import SingleShotNetwork
from shaftpose.training.assembly import build_module, build_trainer
from shaftpose.training.curves import Curves
from shaftpose.training.data import training_data
from tests.pipeline.conftest import recipe_with, settings_with
from tests.pipeline.small_data import FOLDERS, write_training_data

POSES = ("head.pose", "pose_coder.")
JITTER = {"brightness": [1, 2], "contrast": [3, 4], "saturation": [5, 6], "hue_deg": [7, 8]}


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory of all tests here."""
    write_training_data(tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def data_of(folder: Path, *overrides: str) -> TrainingData:
    recipe = recipe_with("profile=smoke", "training.loader_workers=0", *overrides)
    return training_data(recipe, FOLDERS, SkippedImages(folder / "skipped"))


def stream(data: TrainingData) -> TrainingStream:
    images = data.train_dataloader().dataset
    assert isinstance(images, TrainingStream)
    return images


def test_random_views_need_outlines_of_shafts(folder: Path) -> None:
    train = folder / "data/real/train.json"
    outlined = train.read_text()
    tip_alone = '"attributes": {"tip": [150, 100]}, "unknown"'
    train.write_text(outlined.replace('"segmentation"', tip_alone))
    e_real = "profile=smoke", "variant=e_real", "training.loader_workers=0"
    with pytest.raises(InputError, match=r"train\.json: no shaft has a `segmentation`"):
        training_data(recipe_with(*e_real), FOLDERS, SkippedImages(folder / "skipped"), True)
    for known in (outlined, json.dumps(json.loads(outlined) | {"annotations": []})):
        train.write_text(known)
        training_data(recipe_with(*e_real), FOLDERS, SkippedImages(folder / "skipped"), True)


def test_the_optimiser_follows_the_profile() -> None:
    sizes = (
        "steps=40", "detector_steps=30", "warmup_steps=5", "learning_rate=0.003", "optimizer=adam",
    )  # fmt: skip
    recipe = recipe_with("profile=smoke", *(f"profiles.smoke.{size}" for size in sizes),
                         "training.frozen_norm_share=0.25", "variant.start=null")  # fmt: skip
    module = build_module(recipe)
    assert (module.learning_rate, module.total_steps, module.warmup_steps) == (0.003, 40, 5)
    assert module.optimizer == "adam"
    assert module.frozen_norm_from == 30
    assert module.identity == {"variant": "d", "width": 0.1875, "depth": 0.25}


def test_a_detector_takes_its_own_steps_and_no_pose_loss() -> None:
    sizes = ("steps=40", "detector_steps=30")
    overrides = "profile=smoke", *(f"profiles.smoke.{size}" for size in sizes)
    module = build_module(recipe_with("variant=detector", *overrides))
    assert module.total_steps == 30
    assert isinstance(module.network, SingleShotNetwork)
    assert module.network.loss.beta.tolist() == [0.0] * 5
    other = recipe_with("variant=d", *overrides)
    assert (other.size.steps, other.variant.loss["beta"]) == (40, [1.0, 1.0, 2.0, 2.0, 2.0])


def started(path: Path, *overrides: str) -> PoseNetwork:
    """The network that starts from the detector at `path`."""
    recipe = recipe_with("profile=smoke", f"variant.start={path}", *overrides)
    return initial_network(recipe.variant)


def test_a_variant_starts_from_the_detectors_weights(folder: Path, tmp_path: Path) -> None:
    """The weights of backbone, classes and boxes, not those of poses: B has other buffers there."""
    detector = build_module(recipe_with("profile=smoke", "variant=detector"))
    path = tmp_path / "model.ckpt"
    state = {f"network.{name}": value + 1 for name, value in detector.network.state_dict().items()}
    torch.save({"state_dict": state, "identity": detector.identity}, path)
    for variant in ("b", "c", "d"):
        weights = started(path, f"variant={variant}").state_dict()
        learned = {name for name in weights if not name.startswith(POSES)}
        assert learned == {n for n in detector.network.state_dict() if not n.startswith(POSES)}
        assert all(torch.equal(weights[name], state[f"network.{name}"]) for name in learned)
    with pytest.raises(InputError, match=r"'depth': 0.25}, not of .*'depth': 0.5}.*start=null"):
        started(path, "profiles.smoke.depth=0.5")
    bias = state.pop("network.head.box_convs.0.bias")
    torch.save(
        {
            "state_dict": state | {"network.head.box_convs.0.bias": bias[1:]},
            "identity": detector.identity,
        },
        path,
    )
    with pytest.raises(InputError, match=r"weights of other shapes; .*start=null"):
        started(path)
    torch.save({"state_dict": state, "identity": detector.identity}, path)
    with pytest.raises(InputError, match=r"head.box_convs.0.bias is not in both networks"):
        started(path)


@pytest.mark.parametrize(
    ("variant", "noise", "real"),
    [("c", 0, 0), ("d", 0, 0), ("d_noise", 10, 0), ("d_noise_real", 10, 2)],
)
def test_a_variant_has_the_noise_and_the_real_images_of_its_file(
    variant: str, noise: int, real: int, folder: Path
) -> None:
    images = stream(data_of(folder, f"variant={variant}"))
    jitter, *others = images.transforms
    assert isinstance(jitter, ColourJitter)
    assert others == ([UniformNoise(noise)] if noise else [])
    assert images.mixed_in_share == (pytest.approx(2 / 11) if real else 0)
    assert (0 if images.mixed_in is None else len(images.mixed_in)) == real


def test_random_views_without_masks_are_refused(folder: Path) -> None:
    with pytest.raises(InputError, match="^variant.views = true: the network of variant d learns"):
        data_of(folder, "variant=d", "variant.views=true")


def test_images_in_memory_are_augmented_alike(folder: Path) -> None:
    mixed = ("variant=d_noise_real", "variant.symmetries=true")
    read = stream(data_of(folder, *mixed))
    kept = stream(data_of(folder, *mixed, "training.images_in_memory=true"))
    assert isinstance(kept.rendered, ImagesInMemory) and isinstance(kept.mixed_in, ImagesInMemory)
    for _ in range(2):  # the augmentation does not change what is kept
        for n in range(8):
            assert np.array_equal(kept[n][0], read[n][0])
            assert np.array_equal(kept[n][1].boxes, read[n][1].boxes)


def test_colours_change_as_the_settings_say(folder: Path) -> None:
    ranges = [f"training.augmentation.{key}={values}" for key, values in JITTER.items()]
    (jitter,) = stream(data_of(folder, *ranges)).transforms
    assert jitter == ColourJitter((1, 2), (3, 4), (5, 6), (7, 8))


def test_symmetries_change_images_and_boxes_alike(folder: Path) -> None:
    """The bars of these images lie in their boxes, however the images are turned."""
    plain = stream(data_of(folder, "profiles.smoke.symmetries=false"))
    turned = stream(data_of(folder, "profiles.smoke.symmetries=true"))
    changed = 0
    for n in range(8):
        (rgb, known), (before, _) = turned[n], plain[n]
        assert np.array_equal(rgb, turned[n][0])
        changed += not np.array_equal(rgb, before)
        for x0, y0, x1, y1 in known.boxes.astype(int):
            assert rgb[y0:y1, x0:x1].mean() > rgb.mean() + 20
    assert changed > 4


def test_each_part_of_the_split_has_its_use(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither training nor the choice of the threshold sees a test image."""
    data, lists = data_of(folder), folder / "data/split"
    rendered: Any = stream(data).rendered
    validation: Any = data.val_dataloader().dataset
    assert rendered.keys == read_keys(lists, "train")
    assert validation.keys == read_keys(lists, "validation")
    seen: list[str] = []
    image = np.zeros((299, 299, 3), dtype=np.uint8)
    monkeypatch.setattr(ShardedDataset, "rgb", lambda _, key: seen.append(key) or image)
    images = folder / "data/render/images"
    validated_confidence(Blind(), images, lists)  # type: ignore[arg-type]
    assert seen == read_keys(lists, "validation")
    seen.clear()
    first_images(images, lists, "test", 1)
    assert seen == read_keys(lists, "test")[:1]


class Blind:
    """A predictor that finds nothing."""

    confidence = 0.37

    def __call__(self, images: np.ndarray) -> list[Detections]:
        """No detections for each image."""
        return [Detections(np.empty((0, 4)), np.empty(0), np.empty((0, 5))) for _ in images]


@pytest.mark.parametrize(("chosen", "counts_from"), [("null", 0.37), ("0", 0.0), ("0.8", 0.8)])
def test_detections_count_from_the_score_of_the_user_or_of_the_model(
    chosen: str, counts_from: float
) -> None:
    chosen_by_user = settings_with(f"detection.confidence_threshold={chosen}").detection
    threshold = confidence_threshold(chosen_by_user.confidence_threshold, Blind())  # type: ignore[arg-type]
    assert threshold == counts_from


@pytest.mark.parametrize("terminal", [True, False])
def test_a_bar_is_drawn_in_a_terminal_alone(
    folder: Path, terminal: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal)
    trainer = build_trainer(recipe_with("profile=smoke"), folder, Curves())
    assert (trainer.progress_bar_callback is not None) is terminal
