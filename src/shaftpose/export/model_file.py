"""Export of a trained network to one ONNX file, checked against the network."""

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.errors import InputError
from shaftpose.core.files import write_json
from shaftpose.core.shards import ShardedDataset
from shaftpose.dataset.split import read_keys
from shaftpose.export.onnx_export import edge_reader_bytes, export_onnx, store_metadata
from shaftpose.export.parity import Parity, check_parity, edge_difference, mask_difference
from shaftpose.inference.learned_edges import LearnedEdges
from shaftpose.inference.model_files import ModelMetadata
from shaftpose.inference.predictor import Predictor, raw_and_refined_predictors
from shaftpose.inference.shard_prediction import predict_shards
from shaftpose.metrics.detection.average_precision import precision_recall
from shaftpose.metrics.detection.operating_point import best_confidence
from shaftpose.network.detector import ShaftDetector
from shaftpose.network.pose_network import MaskNetwork, PoseNetwork
from shaftpose.settings.schema import DetectionSettings, RenderSettings


def export_model(
    network: PoseNetwork,
    limits: DetectionSettings,
    rendering: RenderSettings,
    images: NDArray[np.uint8],
    out: Path,
) -> Parity:
    """Write `model.onnx` and `parity.json` to `out`.

    images: (N, 299, 299, 3) uint8, to compare file and network on; rendering: settings of the
    training images, whose camera and shaft are stored in the file. The file's thresholds are chosen
    on the validation images of data/render/images. Raises InputError if file and network differ.
    """
    detector, path = ShaftDetector(network, limits), out / "model.onnx"
    export_onnx(detector, path, network.side_px)
    reader = network.edge_reader() if isinstance(network, MaskNetwork) else None
    stored = None
    parity = _parity(detector, Predictor(path), images)
    if reader is not None:
        stored = edge_reader_bytes(reader)
        parity = replace(parity, edge=edge_difference(reader, LearnedEdges(stored)))
    write_json(out / "parity.json", asdict(parity))
    if not parity.holds:
        raise InputError(f"{path}: differs from the checkpoint ({parity}); report this as a bug")
    facts = _facts(rendering, stored)
    store_metadata(path, facts)
    alone, *fitting = raw_and_refined_predictors(path, "mask" if stored is None else "edges")
    facts = replace(facts, confidence=validated_confidence(alone))
    for fit in fitting:
        facts = replace(facts, fit_confidence=validated_confidence(fit))
    store_metadata(path, facts)
    return parity


def _parity(detector: ShaftDetector, predictor: Predictor, images: NDArray[np.uint8]) -> Parity:
    """How far the outputs of the file are from those of the network."""
    network = detector.network
    parity = check_parity(detector, predictor, images, continuous=network.continuous)
    if isinstance(network, MaskNetwork):
        parity = replace(parity, mask=mask_difference(detector, predictor, images))
    return parity


def _facts(rendering: RenderSettings, edge_reader: bytes | None) -> ModelMetadata:
    """What the file states, still without thresholds."""
    shaft, lens = rendering.shaft, rendering.lens.distortion
    return ModelMetadata(
        view_deg=rendering.camera.view_deg,
        # The diameter of an instrument from a CAD file is not a setting.
        shaft_diameter_mm=None if shaft.cad else shaft.diameter_mm,
        shaft_length_mm=None if shaft.cad else shaft.length_mm,
        shaft_tip=None if shaft.cad else shaft.tip,
        distorted=any((*lens.k1, *lens.k2)),
        edge_reader=edge_reader,
    )


def validated_confidence(predictor: Predictor) -> float:
    """The confidence threshold with the best F1 on the validation images."""
    shards = ShardedDataset(Path("data/render/images"))
    found, known = predict_shards(predictor, shards, read_keys(Path("data/split"), "validation"))
    return best_confidence(precision_recall(found, known))
