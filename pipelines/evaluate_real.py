"""Stage `evaluate_real`: detected rate and silhouette IoU on clear and occluded images."""

from shaftpose import tracking
from shaftpose.dataset.silhouette_sets import silhouette_sets
from shaftpose.deployment.prediction import confidence_threshold
from shaftpose.deployment.predictor import Predictor
from shaftpose.deployment.silhouettes import compare_silhouettes
from shaftpose.json_files import read_domain, read_training, write_json
from shaftpose.rendering.optics import middle_camera
from shaftpose.rendering.silhouette import SilhouetteRenderer
from shaftpose.settings.stage import stage
from shaftpose.settings.tree import Settings


@stage
def main(settings: Settings) -> None:
    """Write `silhouette.json` and `silhouettes.jpg` to `out`, and the scores also to `results`."""
    picture, rendering = settings.out / "silhouettes.jpg", settings.rendering
    network = Predictor(settings.model_folder / "model.onnx", "none")
    fitting = Predictor(settings.model_folder / "model.onnx", settings.detection.refine)
    confidence = confidence_threshold(settings.detection.confidence_threshold, network)
    sets = silhouette_sets(middle_camera(rendering), read_domain())
    render = SilhouetteRenderer(rendering)
    scores = compare_silhouettes(network, render, sets, confidence, picture)
    if fitting.refiner:
        fitted = compare_silhouettes(fitting, render, sets, confidence, picture)
        scores |= {f"fitted/{name}": score for name, score in fitted.items()}
    for folder in (settings.out, settings.results):
        write_json(folder / "silhouette.json", scores)
    tracking.connect(settings.tracking.uri, settings.tracking.experiment)
    training_id = read_training(settings.model_folder)["training_id"]
    flat = {
        f"{images}/{metric}": score[metric]
        for images, score in scores.items()
        for metric in ("detected_rate", "iou")
    }
    tracking.log_results(training_id, settings.variant.name, flat, {"silhouettes": picture})


if __name__ == "__main__":
    main()
