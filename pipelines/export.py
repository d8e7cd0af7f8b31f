"""Stage `export`: a checkpoint as one ONNX file, checked against PyTorch on test images."""

import logging
from pathlib import Path

from shaftpose.dataset.split import first_images
from shaftpose.export.checked_export import export_model, store_thresholds
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
    rendered, lists = Path("data/render/images"), Path("data/split")
    images = first_images(rendered, lists, "test", PARITY_IMAGES)
    parity = export_model(network, settings.detection, settings.rendering, images, out)
    views = settings.detection.refine == "views"
    store_thresholds(out / "model.onnx", rendered, lists, views)
    connect(settings.tracking.uri, settings.tracking.experiment)
    training_id, path = read_training(training).training_id, out / "model.onnx"
    log_model(training_id, settings.variant.name, path, images[:1])
    logging.getLogger(__name__).info("the model is in %s; parity with PyTorch: %s", path, parity)


if __name__ == "__main__":
    main()
