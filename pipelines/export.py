"""Stage `export`: a checkpoint as one ONNX file, checked against PyTorch on test images."""

import logging
from dataclasses import asdict
from pathlib import Path

import numpy as np
from networks import trained_network, variant
from predictions import predict
from results import read_training, write_json
from stage import Config, stage

from shaftpose import tracking
from shaftpose.config import DetectionSettings, parse
from shaftpose.dataset.split import read_keys
from shaftpose.deployment.onnx_export import export_onnx, store_metadata
from shaftpose.deployment.parity import check_parity
from shaftpose.deployment.predictor import Predictor
from shaftpose.errors import InputError
from shaftpose.evaluation.average_precision import precision_recall
from shaftpose.evaluation.operating_point import best_confidence
from shaftpose.network.detector import ShaftDetector
from shaftpose.shards import ShardedDataset

logger = logging.getLogger(__name__)

PARITY_IMAGES = 16


@stage
def main(config: Config) -> None:
    """Write `model.onnx` and `parity.json` to `out`, from the checkpoint in `model_folder`."""
    out, training = Path(config["out"]), Path(config["model_folder"])
    out.mkdir(parents=True, exist_ok=True)
    limits = parse(DetectionSettings, config["detection"], "params.yaml: detection")
    network = trained_network(config, training / "model.ckpt")
    detector = ShaftDetector(network, limits.candidates, limits.overlap, limits.most)
    path = out / "model.onnx"
    export_onnx(detector, path, config["camera"]["size_px"])
    images, predictor = test_images(PARITY_IMAGES), Predictor(path)
    parity = check_parity(detector, predictor, images, continuous=network.pose_coder.continuous)
    write_json(out / "parity.json", asdict(parity))
    if not parity.holds:
        raise InputError(f"{path}: differs from the checkpoint ({parity}); report this as a bug")
    store_metadata(
        path,
        confidence=validated_confidence(predictor),
        view_deg=config["camera"]["view_deg"],
        # That of a CAD file's instrument is not a setting.
        shaft_diameter_mm=None if config["shaft"]["cad"] else config["shaft"]["diameter_mm"],
    )
    tracking.connect(**config["tracking"])
    training_id = read_training(training)["training_id"]
    tracking.log_model(training_id, variant(config).name, path, images[:1])
    logger.info("the model is in %s; against PyTorch: %s", path, parity)


def test_images(count: int) -> np.ndarray:
    """The first test images (N, 299, 299, 3) uint8."""
    shards = ShardedDataset(Path("data/render/images"))
    return np.stack([shards.rgb(key) for key in read_keys(Path("data/split"), "test")[:count]])


def validated_confidence(predictor: Predictor) -> float:
    """The score from which on detections count, chosen on the validation images."""
    shards = ShardedDataset(Path("data/render/images"))
    keys = read_keys(Path("data/split"), "validation")
    found = predict(predictor, (shards.rgb(key) for key in keys), len(keys))
    known = [shards.annotations(key) for key in keys]
    return best_confidence(precision_recall(found, known))


if __name__ == "__main__":
    main()
