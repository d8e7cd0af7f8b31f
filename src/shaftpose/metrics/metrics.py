"""All metrics of a test set, and those of the constant predictor."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from shaftpose.core.errors import InputError
from shaftpose.core.geometry import unsigned_deg
from shaftpose.core.instruments import Annotations, Detections
from shaftpose.metrics.detection.matching import Array
from shaftpose.metrics.detection.precision_recall import precision_recall
from shaftpose.metrics.pose_errors import YAW, errors_between, pose_errors
from shaftpose.metrics.table import METRICS, ComparedImages, MetricValues


def compared(
    detections: Sequence[Detections], annotations: Sequence[Annotations], confidence: float = 0.5
) -> ComparedImages:
    """`detections[i]` compared with `annotations[i]`, pose errors at a confidence threshold.

    Raises InputError unless there are as many of both.
    """
    if len(detections) != len(annotations):
        raise InputError(
            f"{len(detections)} images have detections and {len(annotations)} annotations: give "
            "both for the same images, in the same order"
        )
    return ComparedImages(
        detections,
        annotations,
        confidence,
        precision_recall(detections, annotations),
        pose_errors(detections, annotations, confidence),
    )


def measured(images: ComparedImages) -> MetricValues:
    """The metrics of a test set, its numbers of images and instruments, the number of detections
    with a score of at least `confidence`, and this threshold."""
    values = {one.name: one.measure(images) for one in METRICS if one.measure}
    return values | {
        "images": len(images.annotations),
        "instruments": images.instruments,
        "detections": int(np.sum(images.curve.scores >= images.confidence)),
        "confidence": images.confidence,
    }


def evaluate(
    detections: Sequence[Detections], annotations: Sequence[Annotations], confidence: float = 0.5
) -> MetricValues:
    """The metrics of `detections[i]` against `annotations[i]`, see `compared` and `measured`."""
    return measured(compared(detections, annotations, confidence))


def constant_predictor(train: Sequence[Annotations], test: Sequence[Annotations]) -> MetricValues:
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
    return measured(replace(compared([guess] * len(test), test), errors=errors))


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
