"""Results of the stages that evaluate a model, as their JSON files hold them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from shaftpose.metrics.binned_errors import ErrorBin
from shaftpose.metrics.image_metrics import SilhouetteScore
from shaftpose.metrics.pose_errors import FoundInstruments
from shaftpose.metrics.summary import Summary
from shaftpose.metrics.table import MetricValues, metrics_named, metrics_of
from shaftpose.origin import Origin
from shaftpose.stage_files import TrainingRecord

HEADLINES = metrics_of("detection", "pose")
# The sets of test images with masks, of each domain.
OCCLUSIONS = ("clear", "occluded")


@dataclass(frozen=True)
class Accuracy:
    """Accuracy on the test images; precision_recall: the fields of `PrecisionRecall` as lists.

    summary: None in results of older versions.
    """

    metrics: MetricValues
    binned_errors: Mapping[str, Sequence[ErrorBin]]
    found: FoundInstruments
    precision_recall: Mapping[str, Sequence[float]]
    summary: Summary | None = None


@dataclass(frozen=True)
class Evaluation:
    """A trained variant on the test images: `evaluation.json`.

    raw: accuracy of the network's own poses; refined: of refined ones, None if there are none;
    validation: metrics on the validation images, of refined poses if there are any; detection: its
    settings; curves: rows of step, name and value; origin: None in results of older versions.
    """

    title: str
    training: TrainingRecord
    detection: Mapping[str, Any]
    raw: Accuracy
    refined: Accuracy | None
    validation: MetricValues
    curves: Sequence[tuple[int, str, float]]
    origin: Origin | None = None

    @property
    def by_kind(self) -> dict[str, Accuracy]:
        """Accuracy of `raw` and, if there are any, of `refined` poses."""
        return {"raw": self.raw} | ({"refined": self.refined} if self.refined else {})

    def tracked(self) -> dict[str, Any]:
        """The metrics of a tracked run: see `tracked`."""
        return tracked({kind: accuracy.metrics for kind, accuracy in self.by_kind.items()})

    def headlines(self, name: str) -> MetricValues:
        """The metrics for DVC's tables, of refined poses if there are any, as `name/mAP`."""
        metrics = (self.refined or self.raw).metrics
        return {f"{name}/{one.name}": metrics.get(one.name) for one in HEADLINES}


@dataclass(frozen=True)
class Silhouettes:
    """Scores of a model's silhouettes by set of images, such as `rendered/clear`:
    `silhouette.json`.

    raw: of the network's own poses; refined: of refined ones, None if there are none.
    """

    raw: Mapping[str, SilhouetteScore]
    refined: Mapping[str, SilhouetteScore] | None = None

    @property
    def by_kind(self) -> dict[str, Mapping[str, SilhouetteScore]]:
        """Scores of `raw` and, if there are any, of `refined` poses."""
        return {"raw": self.raw} | ({"refined": self.refined} if self.refined else {})

    def tracked(self) -> dict[str, Any]:
        """The metrics of Table II of a tracked run, by set of images: see `tracked`."""
        names = [metric.name for metric in metrics_named("detected_rate", "iou")]
        return tracked(
            {
                kind: {
                    images: {name: getattr(score, name) for name in names}
                    for images, score in scores.items()
                }
                for kind, scores in self.by_kind.items()
            }
        )


def tracked(by_kind: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Values as `test/mAP`, so that all variants have them under one name.

    They are those of refined poses if there are any; raw ones are then `test/raw/mAP`.
    """
    if "refined" not in by_kind:
        return {"test": by_kind["raw"]}
    return {"test": {**by_kind["refined"], "raw": by_kind["raw"]}}
