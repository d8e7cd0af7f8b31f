"""All metrics of a test set, and those of the constant predictor."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from shaftpose.core.errors import InputError
from shaftpose.core.geometry import unsigned_deg
from shaftpose.core.instruments import Annotations, Detections
from shaftpose.metrics.detection.average_precision import average_precision, precision_recall
from shaftpose.metrics.detection.boxes import Array
from shaftpose.metrics.detection.detected_rate import detected_rate
from shaftpose.metrics.pose_errors import YAW, PoseErrors, errors_between, pose_errors


@dataclass(frozen=True)
class Metrics:
    """Metrics of a test set; None is "not measured" or "undefined" (JSON null).

    `x_mm` to `tip_mm` are mean errors of the matched instruments. `detections` counts scores of at
    least `confidence`. `fps` is measured elsewhere and may be added.
    """

    mAP: float | None
    detected_rate: float | None
    x_mm: float | None
    y_mm: float | None
    z_mm: float | None
    pitch_deg: float | None
    yaw_deg: float | None
    axis_deg: float | None
    tip_mm: float | None
    images: int
    instruments: int
    detections: int
    confidence: float
    fps: float | None = None

    def as_dict(self) -> dict[str, float | int | None]:
        """Plain values by name, ready for JSON."""
        return asdict(self)


def evaluate(
    detections: Sequence[Detections], annotations: Sequence[Annotations], confidence: float = 0.5
) -> Metrics:
    """Metrics of `detections[i]` against `annotations[i]`.

    The mAP uses all detections; detected rate and pose errors use scores of at least `confidence`.
    Raises InputError unless there are as many of both.
    """
    if len(detections) != len(annotations):
        raise InputError(
            f"{len(detections)} images have detections and {len(annotations)} annotations: give "
            "both for the same images, in the same order"
        )
    errors = pose_errors(detections, annotations, confidence)
    return _metrics(detections, annotations, errors, confidence)


def constant_predictor(train: Sequence[Annotations], test: Sequence[Annotations]) -> Metrics:
    """Metrics of a predictor that returns the training set's mean box and mean pose.

    A network that does not beat these numbers has learned nothing. The mean yaw is the direction
    of the mean unit vector: 350 and 10 deg give 0, not 180. mAP and detected rate come from the
    box, but pose errors cover all test instruments of known pose: the few whose box happens to
    match lie near the mean and would make the predictor look better.
    """
    box, pose = _mean_box(train), _mean_pose(train)
    guess = Detections(box[None], np.ones(1), pose[None])
    true = np.concatenate([np.empty((0, 5)), *_known_poses(test)])
    errors = errors_between(np.tile(pose, (len(true), 1)), true)
    return _metrics([guess] * len(test), test, errors)


def _metrics(
    detections: Sequence[Detections],
    annotations: Sequence[Annotations],
    errors: PoseErrors,
    confidence: float = 0.5,
) -> Metrics:
    curve = precision_recall(detections, annotations)
    instruments = sum(len(known.boxes) for known in annotations)
    return Metrics(
        mAP=average_precision(curve) if instruments else None,
        detected_rate=detected_rate(detections, annotations, confidence),
        **errors.means(),
        images=len(annotations),
        instruments=instruments,
        detections=int(np.sum(curve.scores >= confidence)),
        confidence=confidence,
    )


def _mean_box(annotations: Sequence[Annotations]) -> Array:
    boxes = np.concatenate([np.empty((0, 4)), *(known.boxes for known in annotations)])
    if not len(boxes):
        raise InputError("the training set holds no instrument: the constant predictor needs one")
    return boxes.mean(axis=0)


def _mean_pose(annotations: Sequence[Annotations]) -> Array:
    poses = np.concatenate([np.empty((0, 5)), *_known_poses(annotations)])
    if not len(poses):
        raise InputError("no training image has poses: the constant predictor needs rendered ones")
    mean = poses.mean(axis=0)
    yaw = np.radians(poses[:, YAW])
    mean[YAW] = unsigned_deg(np.degrees(np.arctan2(np.sin(yaw).mean(), np.cos(yaw).mean())))
    return mean


def _known_poses(annotations: Sequence[Annotations]) -> list[Array]:
    return [known.poses for known in annotations if known.poses is not None]
