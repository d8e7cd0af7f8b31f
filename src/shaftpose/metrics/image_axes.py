"""Errors of tip and axis as seen in the image, which real images without poses allow as well.

Axes are those of `shaftpose.core.geometry.projected_axes`, NaN where they are not known.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from shaftpose.core.geometry import Camera, projected_axes, signed_deg
from shaftpose.core.instruments import Annotations, Detections
from shaftpose.metrics.detection.boxes import Array, matched_poses

_LEAST_PX = 1e-9  # of an axis' length in the image: seen end-on, it has none


@dataclass(frozen=True)
class ImageErrors:
    """Errors of M matched instruments: tip_px (M,), the distance of the tips; axis_deg (M,), the
    angle between the axes; axis_px (M,), the distance from the estimated axis, as an endless line,
    to where the true one leaves the image."""

    tip_px: Array
    axis_deg: Array
    axis_px: Array


def image_errors(
    detections: Sequence[Detections],
    annotations: Sequence[Annotations],
    true_axes: Sequence[Array],
    cameras: Sequence[Camera],
    confidence: float = 0.5,
) -> ImageErrors:
    """Errors of the instruments with a known axis that a detection with a score of at least
    `confidence` hits, matched as for pose errors.

    true_axes: (G, 2, 2) of each image.
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
    tips, ways = both[:, :, 0], both[:, :, 1] - both[:, :, 0]
    ways = ways / np.maximum(np.linalg.norm(ways, axis=-1, keepdims=True), _LEAST_PX)
    angles = np.degrees(np.arctan2(ways[..., 1], ways[..., 0]))
    away = exit_px - tips[:, 0]
    return ImageErrors(
        tip_px=np.linalg.norm(tips[:, 0] - tips[:, 1], axis=-1),
        axis_deg=np.abs(signed_deg(angles[:, 0] - angles[:, 1])),
        axis_px=np.abs(ways[:, 0, 0] * away[:, 1] - ways[:, 0, 1] * away[:, 0]),
    )


def _exits(axes: Array, camera: Camera) -> Array:
    """Where axes (M, 2, 2) px, on their way from the tip, leave the image, (M, 2); the tip itself
    if it lies beyond the border."""
    tips, ways = axes[:, 0], axes[:, 1] - axes[:, 0]
    _, last = camera.span(tips, ways)
    return np.asarray(tips + np.maximum(last, 0) * ways)
