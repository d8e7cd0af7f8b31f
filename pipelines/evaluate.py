"""Stage `evaluate`: the exported model on the test images; metrics and figures."""

from pathlib import Path

from shaftpose import tracking
from shaftpose.core.shards import ShardedDataset
from shaftpose.core.split_lists import read_keys
from shaftpose.deployment.prediction import confidence_threshold
from shaftpose.deployment.predictor import Predictor
from shaftpose.deployment.results import ModelResults, read_curves
from shaftpose.json_files import read_training, write_json
from shaftpose.settings.parsing import as_plain
from shaftpose.settings.stage import stage
from shaftpose.settings.tree import Settings


@stage
def main(settings: Settings) -> None:
    """Write `metrics.json` and `figures/` to `out`, and the report's input to `results`."""
    name, model, detection = settings.variant.name, settings.model_folder, settings.detection
    predictor, training = Predictor(model / "model.onnx"), read_training(model)
    confidence = confidence_threshold(detection.confidence_threshold, predictor)
    shards, keys = ShardedDataset(Path("data/render/images")), read_keys(Path("data/split"), "test")
    found = ModelResults(predictor, shards, keys, confidence)
    figures = found.write_figures(settings.out / "figures", name)
    metrics = found.metrics.as_dict()
    write_json(settings.out / "metrics.json", metrics)
    results = found.for_report(settings.rendering.poses) | {
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
