"""The table of all metrics: how they are named and shown, and how some are measured.

Training, evaluation, report and figures read this table. A new metric of the kinds `detection` and
`pose` is one function and one row. Values of other kinds are measured elsewhere.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from shaftpose.core.instruments import Annotations, Detections
from shaftpose.metrics.detection.matching import Indices, detected_rate
from shaftpose.metrics.detection.precision_recall import PrecisionRecall, average_precision
from shaftpose.metrics.pose_errors import PoseErrors

# Values by name, next to numbers of images and the like; None is "not measured" or "undefined".
MetricValues = Mapping[str, float | int | None]


@dataclass(frozen=True)
class ComparedImages:
    """Detections of a set of images, compared with its annotations.

    curve: over all detections; errors: of the detections with a score of at least `confidence`.
    """

    detections: Sequence[Detections]
    annotations: Sequence[Annotations]
    confidence: float
    curve: PrecisionRecall
    errors: PoseErrors

    @property
    def instruments(self) -> int:
        """Number of annotated instruments."""
        return len(self.image_of)

    @property
    def image_of(self) -> Indices:
        """(G,) number of the image of each annotated instrument."""
        counts = [len(known.boxes) for known in self.annotations]
        return np.repeat(np.arange(len(counts)), counts)


@dataclass(frozen=True)
class Metric:
    """A row of the table.

    digits: decimals that are shown; kind: `pose` is the mean error of detected poses, `rod` that of
    a rod's surface (`symmetric_errors`), `image` the median error in the image, `silhouette` that
    of masks (`image_metrics`), `frames` a metric of whole real frames (`frames.measures`);
    in_paper: whether the paper's tables have it; measure: its value on a test set, None if it is
    measured elsewhere.
    """

    name: str
    title: str
    unit: str
    digits: int
    kind: Literal["detection", "pose", "speed", "rod", "silhouette", "image", "frames"]
    higher_is_better: bool = False
    in_paper: bool = False
    measure: Callable[[ComparedImages], float | None] | None = None

    @property
    def heading(self) -> str:
        """The heading of its column."""
        return f"{self.title} [{self.unit}]" if self.unit else self.title

    @property
    def label(self) -> str:
        """The heading, which says of an error that it is one."""
        return f"{self.title} error [{self.unit}]" if self.unit else self.title


def _mAP(images: ComparedImages) -> float | None:
    return average_precision(images.curve) if images.instruments else None


def _detected_rate(images: ComparedImages) -> float | None:
    return detected_rate(images.detections, images.annotations, images.confidence)


def _mean_of(error: str) -> Callable[[ComparedImages], float | None]:
    return lambda images: images.errors.means()[error]


def _pose(name: str, title: str, in_paper: bool = False) -> Metric:
    unit = name.rpartition("_")[2]
    return Metric(name, title, unit, 2, "pose", in_paper=in_paper, measure=_mean_of(name))


def _frames(name: str, title: str) -> Metric:
    return Metric(name, title, "", 3, "frames", higher_is_better=True)


METRICS = (
    Metric("mAP", "mAP", "", 3, "detection", True, True, _mAP),
    Metric("detected_rate", "Detected rate", "", 3, "detection", True, True, _detected_rate),
    _pose("x_mm", "x", in_paper=True),
    _pose("y_mm", "y", in_paper=True),
    _pose("z_mm", "z", in_paper=True),
    _pose("pitch_deg", "Pitch", in_paper=True),
    _pose("yaw_deg", "Yaw", in_paper=True),
    _pose("axis_deg", "Axis"),
    _pose("tip_mm", "Tip"),
    Metric("fps", "fps", "", 1, "speed", higher_is_better=True),
    Metric("add_s_mm", "ADD-S", "mm", 2, "rod"),
    Metric("mssd_mm", "MSSD", "mm", 2, "rod"),
    Metric("mspd_px", "MSPD", "px", 1, "rod"),
    Metric("iou", "IoU", "", 3, "silhouette", higher_is_better=True, in_paper=True),
    Metric("tip_px", "Tip", "px", 1, "image"),
    Metric("image_axis_deg", "Axis", "deg", 1, "image"),
    Metric("axis_px", "Axis", "px", 1, "image"),
    _frames("box_ap50", "AP50 of boxes"),
    _frames("mask_ap50", "AP50 of masks"),
    _frames("box_recall", "Recall of boxes"),
    _frames("box_precision", "Precision of boxes"),
    _frames("axis_recall", "Recall of axes"),
    _frames("axis_precision", "Precision of axes"),
    _frames("axis_recall_at_precision", "Recall of axes at precision 0.90"),
    _frames("pq", "PQ"),
    _frames("shaft_iou", "IoU per shaft"),
    _frames("image_iou", "IoU per image"),
    _frames("tool_iou", "IoU of tools"),
    Metric("empty_detected", "Frames without a tool with a detection", "", 3, "frames"),
)
_BY_NAME = {metric.name: metric for metric in METRICS}


def metrics_named(*names: str) -> tuple[Metric, ...]:
    """The rows with these names, in this order."""
    return tuple(_BY_NAME[name] for name in names)


def metrics_of(*kinds: str) -> tuple[Metric, ...]:
    """The rows of these kinds, in the table's order."""
    return tuple(metric for metric in METRICS if metric.kind in kinds)
