"""Fixtures shared by tests of studies: an evaluated training, and a comparison of two models."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.core.samples import Instrument, Sample, sample_key
from shaftpose.core.shard_writer import ShardWriter, shard_name
from shaftpose.dataset.split import Split, write_split
from shaftpose.export.onnx_export import store_metadata
from shaftpose.inference.model_files import ModelMetadata
from shaftpose.training.fingerprint import rendered_digest
from studies.model_comparison import Comparison
from tests.conftest import BOXES, SIDE
from tests.evaluations import METRICS, accuracy, evaluation, with_real
from tests.studies.test_evaluate_trainings import write_training

POSES = {"x_mm": [-20.0, 20.0], "pitch_deg": [50.0, 90.0]}
# `constant_model` predicts x = 1 mm, in the same box.
SHAFT = ShaftPose(1.5, -2.0, 20.0, 70.0, 123.0)
KEYS = [sample_key(n) for n in range(5)]


def sample(number: int, *shafts: ShaftPose) -> Sample:
    """A plain image with shafts in the first of `BOXES`."""
    x0, y0, x1, y1 = (int(edge) for edge in BOXES[0])
    mask = np.zeros((SIDE, SIDE), dtype=bool)
    mask[y0:y1, x0:x1] = True
    camera = Camera.from_field_of_view(SIDE, SIDE, 95.0)
    rgb = np.full((SIDE, SIDE, 3), 40 * number, dtype=np.uint8)
    instruments = tuple(Instrument(shaft, mask, mask) for shaft in shafts)
    return Sample(sample_key(number), rgb, instruments, camera, {"source": "tissue-000000"})


def write_data(folder: Path) -> None:
    """Five test images, the first of them without a shaft."""
    with ShardWriter(folder / "data/render/images" / shard_name(0), 95) as shard:
        for n in range(len(KEYS)):
            shard.write(sample(n, SHAFT) if n else sample(n))
    write_split(Split(train=KEYS, validation=KEYS, test=KEYS), folder / "data/split")


@pytest.fixture
def training(constant_model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of an evaluated training, in a project with its data."""
    monkeypatch.chdir(tmp_path)
    write_data(tmp_path)
    trained = with_real("stand-in")
    digest = rendered_digest(Path("data/render/images"), Path("data/split"))
    trained = replace(
        trained,
        data=replace(trained.data, digest=digest),
        recipe={**trained.recipe, "poses": POSES},
    )
    # The best detection is right in four of five images.
    found = evaluation("D + noise + real", trained, raw=accuracy(mAP=0.8))
    folder = write_training(tmp_path, found)
    store_metadata(constant_model, ModelMetadata(0.5, 95.0, 3.0))
    constant_model.rename(folder / "model.onnx")
    return folder


def comparison(**changed: Any) -> Comparison:
    """A comparison for a model with errors of 2 mm and 4 deg."""
    own = METRICS | {"mAP": 0.9, "detected_rate": 0.9, "axis_deg": 4.0, "tip_mm": 2.0}
    moved = {"tip_mm": 0.05, "axis_deg": 0.1}
    growth = dict.fromkeys(METRICS, 0.0)
    return replace(Comparison(own, own | {"mAP": 0.897}, 0.99, moved, growth), **changed)
