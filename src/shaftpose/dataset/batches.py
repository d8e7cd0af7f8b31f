"""Training batches: labelled images, padded and stacked."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from shaftpose.core.images import Image
from shaftpose.core.instruments import UNKNOWN, Annotations

LabelledImage = tuple[Image, Annotations]  # boxes and tips in px of the image


class Targets(NamedTuple):
    """The instruments of a batch, padded to G per image.

    boxes: (B, G, 4) float, x0, y0, x1, y1 in units of the image's side.
    poses: (B, G, 5) float, mm and deg.
    valid: (B, G) bool, False for padding.
    has_pose: (B,) bool, False for images without poses.
    instances: (B, H, W) uint8, see `Annotations`; None if the network does not learn masks.
    tips_px: (B, G, 2) float, tips in images without poses, NaN where unknown; None if all are.
    cameras: (B, 3) float, focal length and principal point in px of the pinhole cameras in which
    the poses are given, (1, 0, 0) without poses; None if the network knows its camera.
    """

    boxes: Tensor
    poses: Tensor
    valid: Tensor
    has_pose: Tensor
    instances: Tensor | None = None
    tips_px: Tensor | None = None
    cameras: Tensor | None = None


class Batch(NamedTuple):
    """images: (B, S, S, 3) uint8 RGB, and their targets."""

    images: Tensor
    targets: Targets


def pad_batch(items: Sequence[LabelledImage]) -> Batch:
    """Stack images (S, S, 3) and pad their instruments to the largest number, at least one."""
    places = max(1, *(len(annotations.boxes) for _, annotations in items))
    boxes = np.zeros((len(items), places, 4), dtype=np.float32)
    poses = np.zeros((len(items), places, 5), dtype=np.float32)
    valid = np.zeros((len(items), places), dtype=bool)
    for n, (rgb, annotations) in enumerate(items):
        count = len(annotations.boxes)
        boxes[n, :count] = annotations.boxes / rgb.shape[0]
        valid[n, :count] = True
        if annotations.poses is not None:
            poses[n, :count] = annotations.poses
    has_pose = torch.tensor([annotations.poses is not None for _, annotations in items])
    targets = Targets(
        torch.from_numpy(boxes),
        torch.from_numpy(poses),
        torch.from_numpy(valid),
        has_pose,
        _stacked_instances(items),
        _padded_tips(items, places),
        torch.tensor([_camera(annotations) for _, annotations in items]),
    )
    return Batch(torch.from_numpy(np.stack([rgb for rgb, _ in items])), targets)


def _camera(known: Annotations) -> tuple[float, float, float]:
    camera = known.camera
    return (1.0, 0.0, 0.0) if camera is None else (camera.focal_px, camera.cx, camera.cy)


def _stacked_instances(items: Sequence[LabelledImage]) -> Tensor | None:
    """Instrument maps (B, H, W), `UNKNOWN` for images without a map; None if no image has one."""
    if all(known.instances is None for _, known in items):
        return None
    unknown = np.full(items[0][0].shape[:2], UNKNOWN, dtype=np.uint8)
    found = [unknown if known.instances is None else known.instances for _, known in items]
    return torch.from_numpy(np.stack(found))


def _padded_tips(items: Sequence[LabelledImage], places: int) -> Tensor | None:
    """Tips (B, G, 2) px, NaN for padding; None if no image has any."""
    if all(known.tips_px is None for _, known in items):
        return None
    tips = np.full((len(items), places, 2), np.nan, dtype=np.float32)
    for n, (_, known) in enumerate(items):
        if known.tips_px is not None:
            tips[n, : len(known.tips_px)] = known.tips_px
    return torch.from_numpy(tips)
