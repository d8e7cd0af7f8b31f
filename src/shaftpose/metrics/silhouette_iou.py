"""Overlap of true masks with silhouettes re-rendered at the estimated poses (paper, Table II).

The paper gives "the IoU" of 20 images without saying how it is pooled. Here it is defined per
image, between the union of the true visible masks and the union of the re-rendered silhouettes of
the detections, and averaged over the images.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shaftpose.core.errors import InputError
from shaftpose.core.instruments import Annotations, Detections
from shaftpose.metrics.bootstrap import mean_interval
from shaftpose.metrics.detection.detected_rate import detected_rate

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class SilhouetteScore:
    """One cell pair of Table II and the number of images and instruments behind it.

    iou_low, iou_high: 95 % confidence interval of `iou`. tip_px, axis_deg, axis_px: median errors
    of tip and axis in the image, see `image_axes`.
    """

    detected_rate: float | None
    iou: float | None
    images: int
    instruments: int
    iou_low: float | None = None
    iou_high: float | None = None
    tip_px: float | None = None
    axis_deg: float | None = None
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
    confidence: float = 0.5,
) -> SilhouetteScore:
    """Detected rate and mean IoU of a set of images.

    overlaps: `silhouette_iou` of each image, with the detections that reach `confidence`.
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
    )
