"""Stage `export`: a checkpoint as one ONNX file, checked against PyTorch on real test images."""

import logging
from dataclasses import asdict
from pathlib import Path

import numpy as np
from networks import trained_network, variant
from results import read_training, write_json
from stage import Config, stage

from shaftpose import tracking
from shaftpose.config import DetectionSettings, parse
from shaftpose.dataset.split import read_keys
from shaftpose.deployment.onnx_export import export_onnx
from shaftpose.deployment.parity import check_parity
from shaftpose.deployment.predictor import Predictor
from shaftpose.errors import InputError
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
    images = test_images(PARITY_IMAGES)
    parity = check_parity(detector, Predictor(path), images)
    write_json(out / "parity.json", asdict(parity))
    if not parity.holds:
        raise InputError(f"{path}: differs from the checkpoint ({parity}); report this as a bug")
    tracking.connect(**config["tracking"])
    training_id = read_training(training)["training_id"]
    tracking.log_model(training_id, variant(config).name, path, images[:1])
    logger.info("the model is in %s; against PyTorch: %s", path, parity)


def test_images(count: int) -> np.ndarray:
    """The first test images (N, 299, 299, 3) uint8."""
    shards = ShardedDataset(Path("data/render/images"))
    return np.stack([shards.rgb(key) for key in read_keys(Path("data/split"), "test")[:count]])


if __name__ == "__main__":
    main()
