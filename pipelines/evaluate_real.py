"""Stage `evaluate_real`: detected rate and silhouette IoU on clear and occluded images."""

import logging
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from networks import variant
from numpy.typing import NDArray
from predictions import predict
from results import read_training, write_json
from settings import render_settings
from stage import Config, stage

from shaftpose import tracking
from shaftpose.config import DetectionSettings, parse
from shaftpose.dataset.coco import load_square, read_coco
from shaftpose.deployment.overlay import (
    FOUND,
    TRUTH,
    contact_sheet,
    draw_masks,
)
from shaftpose.deployment.predictor import Predictor
from shaftpose.evaluation.silhouette_iou import silhouette_score
from shaftpose.images import write_jpeg
from shaftpose.instruments import Annotations
from shaftpose.rendering.silhouette import SilhouetteRenderer
from shaftpose.shards import ShardedDataset

logger = logging.getLogger(__name__)

DRAWN_IMAGES = 4  # of each set


@dataclass(frozen=True)
class TestImage:
    """One image with boxes and visible masks, wherever it comes from."""

    rgb: NDArray[np.uint8]
    known: Annotations
    masks: Sequence[NDArray[np.bool_]]


@stage
def main(config: Config) -> None:
    """Write `silhouette.json` and `silhouettes.jpg` to `out`."""
    out, chosen = Path(config["out"]), variant(config)
    confidence = parse(DetectionSettings, config["detection"], "params.yaml: detection").confidence
    predictor = Predictor(Path(config["model_folder"]) / "model.onnx")
    render = SilhouetteRenderer(render_settings(config))
    scores, drawn = {}, []
    for name, images in test_sets(config["camera"]["size_px"]).items():
        found = predict(predictor, (image.rgb for image in images), len(images))
        silhouettes = [render(detections.above(confidence).poses) for detections in found]
        scores[name] = asdict(
            silhouette_score(
                found, [i.known for i in images], [i.masks for i in images], silhouettes, confidence
            )
        )
        drawn += [
            draw_masks(draw_masks(image.rgb, image.masks, TRUTH), masks, FOUND)
            for image, masks in list(zip(images, silhouettes, strict=True))[:DRAWN_IMAGES]
        ]
    write_json(out / "silhouette.json", scores)
    write_json(Path(config["results"]) / "silhouette.json", scores)
    write_jpeg(contact_sheet(drawn, columns=DRAWN_IMAGES), out / "silhouettes.jpg")
    record(config, chosen.name, scores, out / "silhouettes.jpg")
    logger.info("%s: %s; scores and pictures are in %s", chosen.title, scores, out)


def test_sets(size_px: int) -> dict[str, list[TestImage]]:
    """The rendered and the real (or stand-in) test images, clear and occluded."""
    folder = Path("data/real")
    real = [load_square(image, size_px) for image in read_coco(folder / "test.json")]
    sets = {f"rendered/{name}": rendered_images(name) for name in ("clear", "occluded")}
    for name, occluded in (("clear", False), ("occluded", True)):
        sets[f"real/{name}"] = [
            TestImage(sample.rgb, Annotations(sample.boxes, None), sample.masks)
            for sample in real
            if sample.occluded == occluded and len(sample.boxes)
        ]
    return {name: images for name, images in sets.items() if images}


def rendered_images(name: str) -> list[TestImage]:
    """The images of one of the rendered test sets."""
    shards = ShardedDataset(Path("data/render") / name)
    return [
        TestImage(shards.rgb(key), shards.annotations(key), shards.masks(key))
        for key in shards.keys
    ]


def record(config: Config, name: str, scores: dict[str, dict[str, float]], picture: Path) -> None:
    """Add the scores to the MLflow run of the training."""
    tracking.connect(**config["tracking"])
    training = read_training(Path(config["model_folder"]))
    flat = {
        f"{images}/{metric}": score[metric]
        for images, score in scores.items()
        for metric in ("detected_rate", "iou")
    }
    tracking.log_results(training["training_id"], name, flat, {"silhouettes": picture})


if __name__ == "__main__":
    main()
