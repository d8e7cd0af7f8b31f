"""Stage `export`: a checkpoint as one ONNX file, checked against PyTorch on test images."""

import logging
from pathlib import Path

from shaftpose.dataset.split import first_images
from shaftpose.export.checked_export import (
    check_camera_and_poses,
    export_model,
    store_thresholds,
)
from shaftpose.network.building import trained_network
from shaftpose.settings.stage import stage
from shaftpose.settings.tree import Settings
from shaftpose.stage_files import read_training
from shaftpose.tracking.connection import connect
from shaftpose.tracking.models import log_model

PARITY_IMAGES = 16


@stage
def main(settings: Settings) -> None:
    """Write `model.onnx` and `parity.json` to `out`, from the checkpoint in `model_folder`."""
    out, training = settings.out, settings.model_folder
    out.mkdir(parents=True, exist_ok=True)
    network = trained_network(settings.variant, training / "model.ckpt")
    record, path = read_training(training), out / "model.onnx"
    check_camera_and_poses(record, training, settings.rendering)
    rendered, lists = Path("data/render/images"), Path("data/split")
    images = first_images(rendered, lists, "test", PARITY_IMAGES)
    parity = export_model(network, settings.detection, settings.rendering, images, out)
    store_thresholds(path, rendered, lists, settings.detection.refine == "views")
    connect(settings.tracking.uri, settings.tracking.experiment)
    log_model(record.training_id, settings.variant.name, path, images[:1])
    logging.getLogger(__name__).info("the model is in %s; parity with PyTorch: %s", path, parity)


if __name__ == "__main__":
    main()
