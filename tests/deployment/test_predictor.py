"""Running an exported model."""

from pathlib import Path

import numpy as np
import pytest

from shaftpose.deployment.model_facts import ModelFacts
from shaftpose.deployment.onnx_export import store_facts
from shaftpose.deployment.predictor import Predictor
from shaftpose.errors import InputError


def test_empty_places_are_left_out(constant_model: Path) -> None:
    found = Predictor(constant_model)(np.zeros((3, 299, 299, 3), dtype=np.uint8))
    assert [image.scores.tolist() for image in found] == [[0.75, 0.25]] * 3
    assert found[2].boxes.tolist() == [[10, 20, 110, 220], [150, 10, 290, 90]]
    assert found[2].poses[1].tolist() == [-8, 5, 31, 55, 350]


def test_the_file_keeps_its_confidence(constant_model: Path) -> None:
    store_facts(constant_model, ModelFacts(0.1 + 0.2, 95.0, 3.0))
    assert Predictor(constant_model).confidence == 0.1 + 0.2
    store_facts(constant_model, ModelFacts(0.5, 95.0, 3.0))
    assert Predictor(constant_model).confidence == 0.5


def test_the_file_states_its_camera_and_its_shaft(constant_model: Path) -> None:
    store_facts(constant_model, ModelFacts(0.5, 70.5, 5.0))
    predictor = Predictor(constant_model)
    assert (predictor.facts.view_deg, predictor.facts.shaft_diameter_mm) == (70.5, 5.0)
    assert predictor.side_px == 299
    store_facts(constant_model, ModelFacts(0.5, 70.5, None))  # an instrument from a CAD file
    assert Predictor(constant_model).facts.shaft_diameter_mm is None


def test_a_file_that_states_no_camera_has_the_papers(constant_model: Path) -> None:
    predictor = Predictor(constant_model)
    assert (predictor.facts.view_deg, predictor.facts.shaft_diameter_mm) == (95.0, None)


def test_a_file_without_confidence_is_named(constant_model: Path) -> None:
    message = r"constant\.onnx: holds no confidence threshold; export it again"
    with pytest.raises(InputError, match=message):
        _ = Predictor(constant_model).confidence


@pytest.mark.parametrize("content", [None, b"no model"])
def test_what_is_no_model_is_named(content: bytes | None, tmp_path: Path) -> None:
    path = tmp_path / "model.onnx"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=r"model\.onnx: no(t a readable ONNX| such) model"):
        Predictor(path)
