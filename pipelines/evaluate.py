"""Stage `evaluate`: the exported model on the test images; metrics and figures."""

import csv
import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from networks import variant
from numpy.typing import NDArray
from predictions import predict
from results import read_training, write_json
from settings import render_settings
from stage import Config, stage

from shaftpose import tracking
from shaftpose.config import DetectionSettings, RenderSettings, parse
from shaftpose.dataset.split import read_keys
from shaftpose.deployment.overlay import (
    FOUND,
    TRUTH,
    contact_sheet,
    draw_boxes,
    draw_poses,
)
from shaftpose.deployment.predictor import Predictor
from shaftpose.evaluation.average_precision import precision_recall
from shaftpose.evaluation.figures import pose_error_figure, precision_recall_figure, save_figure
from shaftpose.evaluation.metrics import evaluate
from shaftpose.evaluation.pose_errors import pose_errors
from shaftpose.geometry import Camera
from shaftpose.images import write_jpeg
from shaftpose.instruments import Detections
from shaftpose.shards import ShardedDataset

logger = logging.getLogger(__name__)

DRAWN_IMAGES = 12


@stage
def main(config: Config) -> None:
    """Write `metrics.json` and `figures/` to `out`, and what the report needs to `results`."""
    out, model_folder, chosen = Path(config["out"]), Path(config["model_folder"]), variant(config)
    limits = parse(DetectionSettings, config["detection"], "params.yaml: detection")
    predictor = Predictor(model_folder / "model.onnx")
    shards, keys = ShardedDataset(Path("data/render/images")), read_keys(Path("data/split"), "test")
    found = predict(predictor, (shards.rgb(key) for key in keys), len(keys))
    known = [shards.annotations(key) for key in keys]
    metrics = evaluate(found, known, limits.confidence)
    metrics = replace(metrics, fps=predictor.frames_per_second(shards.rgb(keys[0])))
    curve = precision_recall(found, known)
    folder = out / "figures"
    figures = {
        "precision and recall": folder / "precision_recall.png",
        "pose errors": folder / "pose_errors.png",
        "predictions": folder / "predictions.jpg",
    }
    errors = pose_errors(found, known, limits.confidence)
    save_figure(precision_recall_figure({chosen.title: curve}), figures["precision and recall"])
    save_figure(pose_error_figure(errors), figures["pose errors"])
    confident = [detections.above(limits.confidence) for detections in found]
    sheet = draw_sheet(shards, keys[:DRAWN_IMAGES], confident, render_settings(config))
    write_jpeg(sheet, figures["predictions"], quality=88)
    write_json(out / "metrics.json", metrics.as_dict())
    training = read_training(model_folder)
    results = {
        "title": chosen.title,
        "metrics": metrics.as_dict(),
        "training": training,
        "precision_recall": {name: values.tolist() for name, values in vars(curve).items()},
        "curves": read_curves(model_folder / "curves.csv"),
    }
    write_json(Path(config["results"]) / "evaluation.json", results)
    tracking.connect(**config["tracking"])
    tracking.log_results(training["training_id"], chosen.name, metrics.as_dict(), figures)
    logger.info("%s: %s; metrics and figures are in %s", chosen.title, metrics, out)


def read_curves(path: Path) -> list[list[Any]]:
    """Rows of step, name, value of a training's learning curves."""
    with path.open(newline="") as stream:
        return [[int(r["step"]), r["name"], float(r["value"])] for r in csv.DictReader(stream)]


def draw_sheet(
    shards: ShardedDataset,
    keys: list[str],
    found: list[Detections],
    settings: RenderSettings,
) -> NDArray[np.uint8]:
    """Test images with what is there (green) and what was found (yellow)."""
    side = settings.camera.size_px
    camera = Camera.from_field_of_view(side, side, settings.camera.view_deg)
    drawn = []
    for key, detections in zip(keys, found, strict=False):
        known = shards.annotations(key)
        image = draw_boxes(shards.rgb(key), known.boxes, TRUTH)
        image = draw_boxes(image, detections.boxes, FOUND)
        if known.poses is not None:
            image = draw_poses(image, known.poses, camera, TRUTH, text=False)
        drawn.append(draw_poses(image, detections.poses, camera, FOUND))
    return contact_sheet(drawn, columns=4)


if __name__ == "__main__":
    main()
