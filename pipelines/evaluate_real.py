"""Stage `evaluate_real`: detected rate and silhouette IoU on clear and occluded images."""

import logging
from dataclasses import asdict
from pathlib import Path

from networks import variant
from predictions import least_confidence, predict
from results import read_domain, read_training, write_json
from settings import render_settings
from silhouette_sets import silhouette_sets
from stage import Config, stage
from tqdm import tqdm

from shaftpose import tracking
from shaftpose.deployment.overlay import (
    FOUND,
    TRUTH,
    contact_sheet,
    draw_caption,
    draw_masks,
)
from shaftpose.deployment.predictor import Predictor
from shaftpose.evaluation.silhouette_iou import silhouette_score
from shaftpose.images import write_jpeg
from shaftpose.rendering.optics import middle_camera
from shaftpose.rendering.silhouette import SilhouetteRenderer

logger = logging.getLogger(__name__)

DRAWN_IMAGES = 4  # of each set


@stage
def main(config: Config) -> None:
    """Write `silhouette.json` and `silhouettes.jpg` to `out`, and the scores again to `results`,
    the folder that the report depends on as a whole."""
    out, chosen = Path(config["out"]), variant(config)
    predictor = Predictor(Path(config["model_folder"]) / "model.onnx")
    confidence = least_confidence(config, predictor)
    rendering = render_settings(config)
    render = SilhouetteRenderer(rendering)
    scores, drawn = {}, []
    for name, images in silhouette_sets(middle_camera(rendering), read_domain()).items():
        found = predict(predictor, (image.rgb for image in images), len(images))
        silhouettes = [
            render(detections.above(confidence).poses, image.camera)
            for image, detections in zip(
                images, tqdm(found, "silhouettes", unit="image"), strict=True
            )
        ]
        known, masks = [image.known for image in images], [image.masks for image in images]
        scores[name] = asdict(silhouette_score(found, known, masks, silhouettes, confidence))
        drawn += [
            draw_caption(draw_masks(draw_masks(i.rgb, i.masks, TRUTH), silhouette, FOUND), name)
            for i, silhouette in list(zip(images, silhouettes, strict=True))[:DRAWN_IMAGES]
        ]
    write_json(out / "silhouette.json", scores)
    write_json(Path(config["results"]) / "silhouette.json", scores)
    write_jpeg(contact_sheet(drawn, columns=DRAWN_IMAGES), out / "silhouettes.jpg")
    record(config, chosen.name, scores, out / "silhouettes.jpg")
    logger.info("%s: %s; scores and pictures are in %s", chosen.name, scores, out)


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
