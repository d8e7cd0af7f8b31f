"""Stage `evaluate`: the exported model on the test images; metrics and figures."""

import csv
import logging
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from networks import variant
from predictions import least_confidence, predict
from results import read_training, write_json
from stage import Config, stage

from shaftpose import tracking
from shaftpose.config import PoseRanges, parse
from shaftpose.dataset.split import read_keys
from shaftpose.deployment.overlay import prediction_sheet
from shaftpose.deployment.predictor import Predictor
from shaftpose.evaluation.accuracy_figures import pose_error_figure, precision_recall_figure
from shaftpose.evaluation.average_precision import PrecisionRecall, precision_recall
from shaftpose.evaluation.binned_errors import as_plain, binned_errors
from shaftpose.evaluation.common_instruments import found_instruments
from shaftpose.evaluation.figure_style import save_figure
from shaftpose.evaluation.metrics import evaluate
from shaftpose.evaluation.pose_errors import PoseErrors, pose_errors
from shaftpose.images import Image, write_jpeg
from shaftpose.shards import ShardedDataset

logger = logging.getLogger(__name__)

DRAWN_IMAGES, COLUMNS = 12, 4


@stage
def main(config: Config) -> None:
    """Write `metrics.json` and `figures/` to `out`, and what the report needs to `results`, the
    folder that it depends on as a whole."""
    out, model_folder, chosen = Path(config["out"]), Path(config["model_folder"]), variant(config)
    predictor = Predictor(model_folder / "model.onnx")
    confidence = least_confidence(config, predictor)
    shards, keys = ShardedDataset(Path("data/render/images")), read_keys(Path("data/split"), "test")
    found = predict(predictor, (shards.rgb(key) for key in keys), len(keys))
    known = [shards.annotations(key) for key in keys]
    metrics = evaluate(found, known, confidence)
    metrics = replace(metrics, fps=predictor.frames_per_second(shards.rgb(keys[0])))
    curve = precision_recall(found, known)
    sheet = prediction_sheet(
        [shards.rgb(key) for key in keys[:DRAWN_IMAGES]],
        known[:DRAWN_IMAGES],
        [detections.above(confidence) for detections in found[:DRAWN_IMAGES]],
        [shards.camera(key) for key in keys[:DRAWN_IMAGES]],
        COLUMNS,
    )
    errors = pose_errors(found, known, confidence)
    visible = np.array([part for key in keys for part in shards.visible_fractions(key)])
    ranges = parse(PoseRanges, config["poses"], "params.yaml: poses")
    figures = write_figures(out / "figures", chosen.name, curve, errors, sheet)
    write_json(out / "metrics.json", metrics.as_dict())
    training = read_training(model_folder)
    results = {
        "title": chosen.title,
        "metrics": metrics.as_dict(),
        "training": training,
        "detection": config["detection"],
        "binned_errors": as_plain(binned_errors(errors, visible, ranges)),
        "found": asdict(found_instruments(errors, len(visible))),
        "precision_recall": {name: values.tolist() for name, values in vars(curve).items()},
        "curves": read_curves(model_folder / "curves.csv"),
    }
    write_json(Path(config["results"]) / "evaluation.json", results)
    tracking.connect(**config["tracking"])
    tracking.log_results(training["training_id"], chosen.name, metrics.as_dict(), figures)
    logger.info("%s: %s; metrics and figures are in %s", chosen.name, metrics, out)


def write_figures(
    folder: Path, name: str, curve: PrecisionRecall, errors: PoseErrors, sheet: Image
) -> dict[str, Path]:
    """The figures of one variant: title -> file."""
    figures = {
        "precision and recall": folder / "precision_recall.png",
        "pose errors": folder / "pose_errors.png",
        "predictions": folder / "predictions.jpg",
    }
    save_figure(precision_recall_figure({name: curve}), figures["precision and recall"])
    save_figure(pose_error_figure(errors), figures["pose errors"])
    write_jpeg(sheet, figures["predictions"], quality=88)
    return figures


def read_curves(path: Path) -> list[list[Any]]:
    """Rows of step, name, value of a training's learning curves."""
    with path.open(newline="") as stream:
        return [[int(r["step"]), r["name"], float(r["value"])] for r in csv.DictReader(stream)]


if __name__ == "__main__":
    main()
