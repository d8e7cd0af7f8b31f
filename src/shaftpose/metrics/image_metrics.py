"""Metrics in the image, which real images without poses allow as well.

Silhouettes (paper, Table II) are re-rendered at the estimated poses. The paper gives "the IoU" of
20 images without saying how it is pooled. Here it is defined per image, between the union of the
true visible masks and the union of the silhouettes, and averaged over the images.

Axes are those of `shaftpose.core.geometry.projected_axes`, NaN where they are not known.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.errors import InputError
from shaftpose.core.geometry import Camera, projected_axes, signed_deg
from shaftpose.core.instruments import Annotations, Detections
from shaftpose.metrics.detection.matching import Array, detected_rate, matched_poses
from shaftpose.metrics.summary import mean_interval

Mask = NDArray[np.bool_]

_LEAST_PX = 1e-9  # of an axis' length in the image: seen end-on, it has none


@dataclass(frozen=True)
class ImageErrors:
    """Errors of M matched instruments.

    tip_px: (M,) distance of the tips; axis_deg: (M,) angle between the axes; axis_px: (M,) distance
    from the estimated axis, as an endless line, to where the true one leaves the image.
    """

    tip_px: Array
    axis_deg: Array
    axis_px: Array


@dataclass(frozen=True)
class SilhouetteScore:
    """Scores of a set of images, and the numbers of images and instruments behind them.

    iou_low, iou_high: 95 % confidence interval of `iou`. tip_px, image_axis_deg, axis_px: medians
    of `ImageErrors`.
    """

    detected_rate: float | None
    iou: float | None
    images: int
    instruments: int
    iou_low: float | None = None
    iou_high: float | None = None
    tip_px: float | None = None
    image_axis_deg: float | None = None
    axis_px: float | None = None


def silhouette_iou(
    true_masks: Sequence[Mask], predicted_masks: Sequence[Mask], left_out: Mask | None = None
) -> float | None:
    """IoU of two unions of masks (H, W) of one image.

    left_out: (H, W), pixels outside of the true masks that do not count. 0 if nothing was detected;
    None if there was also nothing to detect. Raises InputError for masks of different sizes.
    """
    masks = [*true_masks, *predicted_masks]
    if len(sizes := {mask.shape for mask in masks}) > 1:
        raise InputError(f"masks of one image have {sorted(sizes)} px: give all the image's size")
    true, predicted = np.any(true_masks, axis=0), np.any(predicted_masks, axis=0)
    if left_out is not None:
        predicted = predicted & (true | ~left_out)
    union = np.count_nonzero(true | predicted)
    return np.count_nonzero(true & predicted) / union if union else None


def silhouette_score(
    detections: Sequence[Detections],
    annotations: Sequence[Annotations],
    overlaps: Sequence[float | None],
    errors: ImageErrors,
    confidence: float = 0.5,
) -> SilhouetteScore:
    """The scores of a set of images.

    overlaps: `silhouette_iou` of each image, with the detections that reach `confidence`; errors:
    of the same detections.
    """
    defined = [overlap for overlap in overlaps if overlap is not None]
    low, high = mean_interval(defined) or (None, None)
    return SilhouetteScore(
        detected_rate=detected_rate(detections, annotations, confidence),
        iou=float(np.mean(defined)) if defined else None,
        images=len(annotations),
        instruments=sum(len(known.boxes) for known in annotations),
        iou_low=low,
        iou_high=high,
        tip_px=_median(errors.tip_px),
        image_axis_deg=_median(errors.axis_deg),
        axis_px=_median(errors.axis_px),
    )


def _median(errors: Array) -> float | None:
    return float(np.median(errors)) if len(errors) else None


def image_errors(
    detections: Sequence[Detections],
    annotations: Sequence[Annotations],
    true_axes: Sequence[Array],
    cameras: Sequence[Camera],
    confidence: float = 0.5,
) -> ImageErrors:
    """Errors of matched instruments with a known axis.

    Matches are those of pose errors, with scores of at least `confidence`; true_axes: (G, 2, 2) of
    each image.
    """
    pairs, exits = [np.empty((0, 2, 2, 2))], [np.empty((0, 2))]
    for found, known, true, camera in zip(detections, annotations, true_axes, cameras, strict=True):
        poses, matched = matched_poses(found, known.boxes, confidence)
        seen = projected_axes(poses, camera)
        pairs.append(np.stack([seen, true[matched]], axis=1))
        exits.append(_exits(true[matched], camera))
    both, exit_px = np.concatenate(pairs), np.concatenate(exits)
    of_known_axes = np.isfinite(both).all(axis=(1, 2, 3))
    both, exit_px = both[of_known_axes], exit_px[of_known_axes]
    tips, directions = both[:, :, 0], _unit(both[:, :, 1] - both[:, :, 0])
    angles = np.degrees(np.arctan2(directions[..., 1], directions[..., 0]))
    away = exit_px - tips[:, 0]
    return ImageErrors(
        tip_px=np.linalg.norm(tips[:, 0] - tips[:, 1], axis=-1),
        axis_deg=np.abs(signed_deg(angles[:, 0] - angles[:, 1])),
        axis_px=np.abs(directions[:, 0, 0] * away[:, 1] - directions[:, 0, 1] * away[:, 0]),
    )


def _unit(ways: Array) -> Array:
    return np.asarray(ways / np.maximum(np.linalg.norm(ways, axis=-1, keepdims=True), _LEAST_PX))


def _exits(axes: Array, camera: Camera) -> Array:
    """Where axes (M, 2, 2) px, on their way from the tip, leave the image, (M, 2); the tip itself
    if it lies beyond the border."""
    tips, directions = axes[:, 0], _unit(axes[:, 1] - axes[:, 0])
    _, last = camera.span(tips, directions)
    return np.asarray(tips + np.maximum(last, 0) * directions)
