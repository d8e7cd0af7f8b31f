"""Stage `evaluate`: the exported model on the test images; metrics and figures."""

from dataclasses import asdict
from pathlib import Path

from shaftpose.core.files import write_json
from shaftpose.core.shards import ShardedDataset
from shaftpose.dataset.split import read_keys
from shaftpose.evaluation.model_results import ModelResults, evaluation, read_curves
from shaftpose.inference.predictor import raw_and_refined_predictors
from shaftpose.inference.shard_prediction import confidence_threshold
from shaftpose.settings.stage import stage
from shaftpose.settings.tree import Settings
from shaftpose.stage_files import read_training
from shaftpose.tracking.connection import connect
from shaftpose.tracking.trainings import log_results


@stage
def main(settings: Settings) -> None:
    """Write `metrics.json` and `figures/` to `out`, and the report's input to `results`."""
    name, model, detection = settings.variant.name, settings.model_folder, settings.detection
    images, training = ShardedDataset(Path("data/render/images")), read_training(model)
    curves = read_curves(model / "curves.csv")
    keys, validation = (read_keys(Path("data/split"), part) for part in ("test", "validation"))
    predictors = raw_and_refined_predictors(model / "model.onnx", detection.refine)
    thresholds = [confidence_threshold(detection.confidence_threshold, one) for one in predictors]
    results = [ModelResults(*one, images, keys) for one in zip(predictors, thresholds, strict=True)]
    strip = settings.results / "predictions.jpg"
    figures = results[-1].write_figures(settings.out / "figures", name, strip)
    result = evaluation(settings, training, curves, validation, *results)
    write_json(settings.out / "metrics.json", result.headlines(name))
    write_json(settings.results / "evaluation.json", asdict(result))
    connect(settings.tracking.uri, settings.tracking.experiment)
    log_results(training.training_id, name, result.tracked(), figures)


if __name__ == "__main__":
    main()
