"""Confidence thresholds of an exported model."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from shaftpose.core.errors import InputError
from shaftpose.core.shards import ShardedDataset
from shaftpose.dataset.split import read_keys
from shaftpose.export.checked_export import check_camera_and_poses, store_thresholds
from shaftpose.export.onnx_export import store_metadata
from shaftpose.inference.model_files import ModelMetadata
from shaftpose.inference.predictor import Predictor
from shaftpose.settings.parsing import as_plain
from tests.conftest import write_constant_model
from tests.evaluations import TRAINING
from tests.pipeline.conftest import settings_with
from tests.pipeline.small_data import FOLDERS, write_training_data


def test_thresholds_join_what_the_file_states(tmp_path: Path) -> None:
    """A model that finds a validation image's first shaft, in the turned copies too."""
    write_training_data(tmp_path)
    images, lists = tmp_path / FOLDERS.rendered, tmp_path / FOLDERS.split
    first = ShardedDataset(images).annotations(read_keys(lists, "validation")[0])
    assert first.poses is not None
    found = {"boxes": first.boxes[:1], "scores": np.array([0.75]), "poses": first.poses[:1]}
    path = write_constant_model(tmp_path / "constant.onnx", found)
    stated = ModelMetadata(view_deg=70.5, shaft_diameter_mm=0.1 + 0.2, shaft_tip="flat")
    store_metadata(path, stated)
    store_thresholds(path, images, lists, views=False)
    assert Predictor(path).metadata == replace(stated, confidence=0.75)
    store_thresholds(path, images, lists, views=True)
    # In the image, the shaft of each of the eight copies lies elsewhere.
    assert Predictor(path).metadata == replace(stated, confidence=0.75, views_confidence=0.75 / 8)


def test_another_camera_than_the_trainings_is_refused(tmp_path: Path) -> None:
    rendering = settings_with("variant=d").rendering
    recipe = {name: as_plain(getattr(rendering, name)) for name in ("camera", "poses")}
    check_camera_and_poses(replace(TRAINING, recipe=recipe), tmp_path, rendering)
    recipe["camera"] = recipe["camera"] | {"view_deg": 71.5}
    with pytest.raises(InputError, match=r"camera\.view_deg = 71\.5, the settings say 95\.0"):
        check_camera_and_poses(replace(TRAINING, recipe=recipe), tmp_path, rendering)
