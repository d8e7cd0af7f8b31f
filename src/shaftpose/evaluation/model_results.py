"""Results of a model on the test images: metrics, figures, and values for the report."""

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.errors import InputError
from shaftpose.core.geometry import Camera
from shaftpose.core.images import Image, write_jpeg
from shaftpose.core.shards import ShardedDataset
from shaftpose.evaluation.results import Accuracy, Evaluation
from shaftpose.figures.accuracy_figures import (
    error_over_bound_figure,
    pose_error_figure,
    precision_recall_figure,
)
from shaftpose.figures.drawing import prediction_sheet
from shaftpose.figures.style import save_figure
from shaftpose.inference.predictor import Predictor
from shaftpose.inference.shard_prediction import predict_shards
from shaftpose.metrics.binned_errors import binned_errors
from shaftpose.metrics.metrics import compared, evaluate, measured
from shaftpose.metrics.pose_errors import found_instruments
from shaftpose.metrics.summary import Summary, summary
from shaftpose.metrics.symmetric_errors import symmetric_errors
from shaftpose.metrics.table import ComparedImages, MetricValues
from shaftpose.origin import origin
from shaftpose.refinement.bound import pose_bound
from shaftpose.settings.parsing import as_plain
from shaftpose.settings.schema import RenderSettings, ShaftSettings
from shaftpose.settings.tree import Settings
from shaftpose.stage_files import TrainingRecord

DRAWN_IMAGES, COLUMNS = 12, 4
WORST, WORST_COLUMNS = 10, 5  # images with large errors, and as many with missed shafts


class ModelResults:
    """A model's results on images of `shards`.

    confidence: the confidence threshold, which mAP ignores.
    """

    def __init__(
        self, predictor: Predictor, confidence: float, shards: ShardedDataset, keys: Sequence[str]
    ) -> None:
        self.predictor, self.shards, self.keys = predictor, shards, keys
        self.images = compared(*predict_shards(predictor, shards, keys), confidence)
        fps = predictor.frames_per_second(shards.rgb(keys[0]))
        self.metrics: MetricValues = {**measured(self.images), "fps": fps}

    def write_figures(self, folder: Path, title: str, strip: Path) -> dict[str, Path]:
        """Draw the figures: title -> file; and, for the report, a row of predictions, `strip`."""
        figures = {
            "precision and recall": folder / "precision_recall.png",
            "pose errors": folder / "pose_errors.png",
            "predictions": folder / "predictions.jpg",
        }
        save_figure(
            precision_recall_figure({title: self.images.curve}), figures["precision and recall"]
        )
        save_figure(pose_error_figure(self.images.errors), figures["pose errors"])
        first = range(min(DRAWN_IMAGES, len(self.keys)))
        write_jpeg(self._sheet(first, COLUMNS), figures["predictions"], quality=88)
        write_jpeg(self._sheet(first[:COLUMNS], COLUMNS), strip, quality=80)
        if worst := worst_images(self.images, WORST):
            figures["worst predictions"] = folder / "worst_predictions.jpg"
            sheet = self._sheet(worst, WORST_COLUMNS)
            write_jpeg(sheet, figures["worst predictions"], quality=88)
        if (refiner := self.predictor.refiner) is not None:
            figures["errors over bounds"] = folder / "errors_over_bounds.png"
            camera, true = self.predictor.camera, self.images.errors.true_poses
            bounds = [pose_bound(pose, refiner.shaft, camera) for pose in true]
            figure = error_over_bound_figure(self.images.errors, np.reshape(bounds, (-1, 5)))
            save_figure(figure, figures["errors over bounds"])
        return figures

    def _sheet(self, images: Sequence[int], columns: int) -> Image:
        """Annotations and detections of the images with these numbers."""
        keys = [self.keys[n] for n in images]
        found = [self.images.detections[n].above(self.images.confidence) for n in images]
        known = [self.images.annotations[n] for n in images]
        rgb, cameras = map(self.shards.rgb, keys), map(self.shards.camera, keys)
        return prediction_sheet(list(rgb), known, found, list(cameras), columns)

    def metrics_on(self, keys: Sequence[str]) -> MetricValues:
        """The model's metrics on other images of the shards."""
        found, known = predict_shards(self.predictor, self.shards, keys)
        return evaluate(found, known, self.images.confidence)

    def accuracy(self, rendering: RenderSettings) -> Accuracy:
        """The values for the report; rendering: of the images."""
        fractions = [part for key in self.keys for part in self.shards.visible_fractions(key)]
        visible, cameras = np.array(fractions), self._cameras()
        tips = zip(cameras, self.images.errors.true_poses[:, :3], strict=True)
        border = np.array([camera.border_px(camera.project(tip)) for camera, tip in tips])
        return Accuracy(
            metrics=self.metrics,
            binned_errors=binned_errors(
                self.images.errors, visible, border, rendering.poses.low, rendering.poses.high
            ),
            found=found_instruments(self.images.errors, len(visible)),
            precision_recall={name: v.tolist() for name, v in vars(self.images.curve).items()},
            summary=self._summary(rendering.shaft, cameras),
        )

    def _cameras(self) -> list[Camera]:
        """The camera that saw each detected instrument."""
        images = self.images.image_of[self.images.errors.instruments].tolist()
        cameras = {n: self.shards.camera(self.keys[n]) for n in set(images)}
        return [cameras[n] for n in images]

    def _summary(self, shaft: ShaftSettings, cameras: Sequence[Camera]) -> Summary:
        true, further = self.images.errors.true_poses, dict[str, NDArray[np.float64]]()
        if not shaft.cad:  # whose diameter is not known
            estimated = true + self.images.errors.differences
            further = vars(symmetric_errors(estimated, true, shaft.diameter_mm, cameras))
        return summary(self.images, further)


def worst_images(images: ComparedImages, count: int) -> list[int]:
    """The images with the largest errors: their numbers.

    First `count` with the largest tip errors, the largest first, then as many others with missed
    instruments.
    """
    errors, image_of = images.errors, images.image_of
    by_error = errors.instruments[np.argsort(-errors.tip_mm, kind="stable")]
    missed = np.setdiff1d(np.arange(len(image_of)), errors.instruments)
    far = list(dict.fromkeys(image_of[by_error].tolist()))[:count]
    others = [n for n in dict.fromkeys(image_of[missed].tolist()) if n not in far]
    return far + others[:count]


def evaluation(
    settings: Settings,
    training: TrainingRecord,
    curves: Sequence[tuple[int, str, float]],
    validation: Sequence[str],
    raw: ModelResults,
    refined: ModelResults | None = None,
) -> Evaluation:
    """The evaluation of a network's own poses and, if there are any, of refined ones.

    validation: keys of the validation images.
    """
    rendering = settings.rendering
    return Evaluation(
        title=settings.variant.title,
        training=training,
        detection=as_plain(settings.detection),
        raw=raw.accuracy(rendering),
        refined=None if refined is None else refined.accuracy(rendering),
        validation=(refined or raw).metrics_on(validation),
        curves=curves,
        origin=origin(),
    )


def read_curves(path: Path) -> list[tuple[int, str, float]]:
    """The learning curves of a training, as rows of step, name, value. Raises InputError if the
    file is missing."""
    if not path.is_file():
        raise InputError(f"{path}: missing; train the variant again")
    with path.open(newline="") as stream:
        return [(int(r["step"]), r["name"], float(r["value"])) for r in csv.DictReader(stream)]
