"""Stage `evaluate_real`: detected rate and silhouette IoU on clear and occluded images."""

from dataclasses import asdict
from pathlib import Path

from shaftpose.core.files import write_json
from shaftpose.evaluation.masked_images import masked_images
from shaftpose.evaluation.silhouettes import compare_silhouettes
from shaftpose.inference.predictor import raw_and_refined_predictors
from shaftpose.inference.shard_prediction import confidence_threshold
from shaftpose.rendering.optics import middle_camera
from shaftpose.rendering.silhouette import SilhouetteRenderer
from shaftpose.settings.stage import stage
from shaftpose.settings.tree import Settings
from shaftpose.stage_files import read_domain, read_training
from shaftpose.tracking.connection import connect
from shaftpose.tracking.trainings import log_results


@stage
def main(settings: Settings) -> None:
    """Write pictures to `out`, and the report's input to `results`."""
    render = SilhouetteRenderer(settings.rendering)
    predictors = raw_and_refined_predictors(
        settings.model_folder / "model.onnx", settings.detection.refine
    )
    stated = settings.detection.confidence_threshold
    confidences = [confidence_threshold(stated, one) for one in predictors]
    unposed, camera = Path("data/real"), middle_camera(settings.rendering)
    sets = masked_images(Path("data/render"), unposed, read_domain(unposed), camera)
    scores, pictures = compare_silhouettes(predictors, confidences, render, sets, settings.out)
    write_json(settings.results / "silhouette.json", asdict(scores))
    connect(settings.tracking.uri, settings.tracking.experiment)
    training_id = read_training(settings.model_folder).training_id
    log_results(training_id, settings.variant.name, scores.tracked(), pictures)


if __name__ == "__main__":
    main()
