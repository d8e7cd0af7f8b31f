"""Stage `evaluate`: the exported model on the test images; metrics and figures."""

from pathlib import Path

from shaftpose import tracking
from shaftpose.core.shards import ShardedDataset
from shaftpose.core.split_lists import read_keys
from shaftpose.deployment.prediction import confidence_threshold
from shaftpose.deployment.predictor import Predictor
from shaftpose.deployment.results import ModelResults, flat, read_curves
from shaftpose.json_files import read_training, write_json
from shaftpose.settings.parsing import as_plain
from shaftpose.settings.stage import stage
from shaftpose.settings.tree import Settings


@stage
def main(settings: Settings) -> None:
    """Write `metrics.json` and `figures/` to `out`, and the report's input to `results`."""
    name, model, detection = settings.variant.name, settings.model_folder, settings.detection
    images, training = ShardedDataset(Path("data/render/images")), read_training(model)
    keys = read_keys(Path("data/split"), "test")
    network = Predictor(model / "model.onnx", "none")
    fitting = Predictor(model / "model.onnx", detection.refine)
    confidence = confidence_threshold(detection.confidence_threshold, network)
    alone = ModelResults(network, images, keys, confidence)
    fitted = ModelResults(fitting, images, keys, confidence) if fitting.refiner else None
    figures = (fitted or alone).write_figures(settings.out / "figures", name)
    metrics = flat(alone, fitted)
    write_json(settings.out / "metrics.json", metrics)
    results = alone.for_report(settings.rendering.poses) | {
        "fitted": fitted and fitted.for_report(settings.rendering.poses),
        "title": settings.variant.title,
        "training": training,
        "detection": as_plain(detection),
        "curves": read_curves(model / "curves.csv"),
    }
    write_json(settings.results / "evaluation.json", results)
    tracking.connect(settings.tracking.uri, settings.tracking.experiment)
    tracking.log_results(training["training_id"], name, metrics, figures)


if __name__ == "__main__":
    main()
