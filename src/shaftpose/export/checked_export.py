"""Export of a trained network to one ONNX file that has been checked against it."""

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.errors import InputError
from shaftpose.core.files import write_json
from shaftpose.core.shards import ShardedDataset
from shaftpose.dataset.split import read_keys
from shaftpose.export.onnx_export import (
    ShaftDetector,
    edge_reader_bytes,
    export_onnx,
    store_metadata,
)
from shaftpose.export.parity import Parity, check_parity, edge_difference, mask_difference
from shaftpose.inference.learned_edges import LearnedEdges
from shaftpose.inference.model_files import ModelMetadata
from shaftpose.inference.predictor import Predictor, raw_and_refined_predictors
from shaftpose.inference.shard_prediction import predict_shards
from shaftpose.metrics.detection.precision_recall import best_confidence, precision_recall
from shaftpose.network.pose_network import MaskNetwork, PoseNetwork
from shaftpose.settings.choices import Refinement
from shaftpose.settings.parsing import as_plain
from shaftpose.settings.schema import DetectionSettings, RenderSettings
from shaftpose.stage_files import TrainingRecord


def export_model(
    network: PoseNetwork,
    limits: DetectionSettings,
    rendering: RenderSettings,
    images: NDArray[np.uint8],
    out: Path,
) -> Parity:
    """Write `model.onnx`, still without confidence thresholds, and `parity.json` to `out`.

    images: (N, S, S, 3) uint8, on which file and network are compared. rendering: settings of
    the training images, whose camera and shaft are stored in the file. Raises InputError if file
    and network differ.
    """
    detector, path = ShaftDetector(network, limits), out / "model.onnx"
    export_onnx(detector, path, network.side_px)
    parity = _parity(detector, Predictor(path), images)
    reader = network.edge_reader() if isinstance(network, MaskNetwork) else None
    stored = None if reader is None else edge_reader_bytes(reader)
    if reader is not None and stored is not None:
        parity = replace(parity, edge=edge_difference(reader, LearnedEdges(stored)))
    write_json(out / "parity.json", asdict(parity))
    if not parity.holds:
        raise InputError(f"{path}: differs from the checkpoint ({parity}); report this as a bug")
    store_metadata(path, _metadata(rendering, stored))
    return parity


def check_camera_and_poses(
    training: TrainingRecord, folder: Path, rendering: RenderSettings
) -> None:
    """Raise InputError if a network was trained with another camera or other poses than those of
    the settings, which its file would state."""
    for section in ("camera", "poses"):
        trained = training.recipe[section]
        for name, value in as_plain(getattr(rendering, section)).items():
            if trained[name] != value:
                raise InputError(
                    f"{folder}: was trained with {section}.{name} = {trained[name]}, the settings "
                    f"say {value}; set the former, or train again"
                )


def store_thresholds(path: Path, images: Path, lists: Path, views: bool) -> None:
    """Choose the confidence thresholds of a model on validation images, and store them in its file.

    images: a folder of shards; lists: the folder of their split. views: whether one is chosen for
    poses refined in views, which takes about ten times as long.
    """
    metadata = Predictor(path, "none").metadata
    fit: Refinement = "mask" if metadata.edge_reader is None else "edges"
    raw, *fitted = raw_and_refined_predictors(path, fit)
    metadata = replace(metadata, confidence=validated_confidence(raw, images, lists))
    for predictor in fitted:
        best = validated_confidence(predictor, images, lists)
        metadata = replace(metadata, fit_confidence=best)
    if views:
        best = validated_confidence(Predictor(path, "views"), images, lists)
        metadata = replace(metadata, views_confidence=best)
    store_metadata(path, metadata)


def validated_confidence(predictor: Predictor, images: Path, lists: Path) -> float:
    """The confidence threshold with the best F1 on validation images; see `store_thresholds`."""
    keys = read_keys(lists, "validation")
    found, known = predict_shards(predictor, ShardedDataset(images), keys)
    return best_confidence(precision_recall(found, known))


def _parity(detector: ShaftDetector, predictor: Predictor, images: NDArray[np.uint8]) -> Parity:
    """The differences between the outputs of the file and of the network."""
    network = detector.network
    parity = check_parity(detector, predictor, images, continuous=network.continuous)
    if isinstance(network, MaskNetwork):
        parity = replace(parity, mask=mask_difference(detector, predictor, images))
    return parity


def _metadata(rendering: RenderSettings, edge_reader: bytes | None) -> ModelMetadata:
    """The metadata of a file without thresholds."""
    shaft, lens = rendering.shaft, rendering.lens.distortion
    return ModelMetadata(
        view_deg=rendering.camera.view_deg,
        low_pitch_deg=rendering.poses.pitch_deg[0],
        high_pitch_deg=rendering.poses.pitch_deg[1],
        side_px=rendering.camera.size_px,
        # The diameter of an instrument from a CAD file is not a setting.
        shaft_diameter_mm=None if shaft.cad else shaft.diameter_mm,
        shaft_length_mm=None if shaft.cad else shaft.length_mm,
        shaft_tip=None if shaft.cad else shaft.tip,
        distorted=any((*lens.k1, *lens.k2)),
        edge_reader=edge_reader,
    )
