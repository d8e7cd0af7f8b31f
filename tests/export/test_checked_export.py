"""Confidence thresholds of an exported model."""

from dataclasses import replace
from pathlib import Path

from shaftpose.export.checked_export import store_thresholds, validated_confidence
from shaftpose.export.onnx_export import store_metadata
from shaftpose.inference.model_files import ModelMetadata
from shaftpose.inference.predictor import Predictor
from tests.pipeline.small_data import FOLDERS, write_training_data


def test_the_threshold_joins_what_the_file_states(constant_model: Path, tmp_path: Path) -> None:
    write_training_data(tmp_path)
    images, lists = tmp_path / FOLDERS.rendered, tmp_path / FOLDERS.split
    store_metadata(constant_model, ModelMetadata())
    store_thresholds(constant_model, images, lists, views=False)
    assert Predictor(constant_model).metadata.views_confidence is None
    stated = ModelMetadata(view_deg=70.5, shaft_diameter_mm=0.1 + 0.2, shaft_tip="flat")
    store_metadata(constant_model, stated)
    store_thresholds(constant_model, images, lists, views=True)
    predictor = Predictor(constant_model)
    chosen = validated_confidence(predictor, images, lists)
    assert 0 <= chosen <= 1
    in_views = validated_confidence(Predictor(constant_model, "views"), images, lists)
    assert predictor.metadata == replace(stated, confidence=chosen, views_confidence=in_views)
