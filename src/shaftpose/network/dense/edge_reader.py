"""E's edge reader: finds the outline of a shaft near a supposed one, and says how sure it is.

It reads strips of the image along the supposed outline (`refinement.contour_sampling`). Highlights
inside the metal, shadows and other shafts often have stronger edges than the outline. The reader
learns to ignore them, from random outlines near those of annotated shafts.
"""

from collections.abc import Iterator
from typing import NamedTuple

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from shaftpose.core.geometry import Camera, axis_direction
from shaftpose.core.instruments import OUTSIDE
from shaftpose.dataset.batches import Targets
from shaftpose.network.dense.layers import Residual, conv_norm_relu
from shaftpose.refinement.contour import Array, Contour, Shaft, shaft_contour
from shaftpose.refinement.contour_sampling import COLUMNS, MIDDLE, ROWS, outline_strips
from shaftpose.refinement.pose_parameters import moved

# The reader.
_FINE, _CHANNELS = 16, 64
_KERNEL, _DILATIONS = (5, 1), (1, 2, 4, 8)  # along the outline
_LOG_SCALES = (-4.0, 3.0)  # limits of the predicted logarithms
_SMOOTH_L1_WEIGHT = 0.1
# Its samples.
_OUTLINES = 4  # for each shaft
_STEP_PX = (0.25, 0.5)  # range of the distance between columns
# Standard deviations of the pose's parameters at the widest step, times a random size: a fit to a
# mask may end near the true outline or far from it.
_SPREAD, _SIZES = np.array([1.5, 1.5, 0.05, 5.0, 3.0]), (0.04, 2.0)
_BORDER_PX = 9  # window around the border of the visible field in which no edge is to be learned
_OUTERMOST = 2  # columns at the ends, where no edge is to be learned
# Places at which the true outline is searched, close enough that it passes at most once between two
# even of the thinnest shaft, and bisections between them.
_PLACES, _HALVINGS = 11, 6


class EdgeSamples(NamedTuple):
    """Strips along supposed outlines, and where the true ones are.

    colours: (M, 3, ROWS, COLUMNS) in [-1, 1]; offsets: (M, ROWS) of the true outline from the
    middle column, in columns, positive outwards, clipped to the outermost columns with an edge;
    known: (M, ROWS) bool, rows inside the image.
    """

    colours: Tensor
    offsets: Tensor
    known: Tensor


class EdgeReader(nn.Module):
    """Two convolutions on the strip, then, with the columns as channels, convolutions along it."""

    def __init__(self) -> None:
        super().__init__()
        self.fine = nn.Sequential(
            *conv_norm_relu(3, _FINE),
            *conv_norm_relu(_FINE, _FINE, stride=(1, 2)),
            *conv_norm_relu(_FINE, _CHANNELS, (1, (COLUMNS + 1) // 2), padded=False),
        )
        self.along = nn.Sequential(
            *(Residual(_CHANNELS, _KERNEL, (dilation, 1)) for dilation in _DILATIONS)
        )
        self.values = nn.Conv2d(_CHANNELS, 2, 1)

    def forward(self, strips: Tensor) -> tuple[Tensor, Tensor]:
        """Strips (M, 3, ROWS, COLUMNS) in [-1, 1] -> offsets (M, ROWS) of the outline from the
        middle column, in columns, and the logarithms (M, ROWS) of their expected errors."""
        offsets, log_scales = self.values(self.along(self.fine(strips)))[..., 0].unbind(1)
        return MIDDLE * torch.tanh(offsets / MIDDLE), log_scales.clamp(*_LOG_SCALES)

    def loss(self, samples: EdgeSamples) -> Tensor:
        """Negative log-likelihood of Laplace distributions plus a little smooth L1, a scalar.

        Smooth L1 does not depend on the predicted errors.
        """
        offsets, log_scales = self(samples.colours)
        errors = (offsets.float() - samples.offsets).abs()
        plain = functional.smooth_l1_loss(offsets.float(), samples.offsets, reduction="none")
        likelihood = errors * torch.exp(-log_scales.float()) + log_scales.float()
        losses = likelihood + _SMOOTH_L1_WEIGHT * plain
        return (losses * samples.known).sum() / samples.known.sum().clamp(min=1)


def edge_samples(images: Tensor, targets: Targets, shaft: Shaft) -> EdgeSamples:
    """Samples at random outlines near all shafts with known poses, in the targets' cameras.

    images: (B, 3, H, W) in [-1, 1]. Random numbers depend on torch's generator.
    """
    assert targets.cameras is not None and targets.instances is not None
    rng = np.random.default_rng(int(torch.randint(2**62, ())))
    pictures = images.float().permute(0, 2, 3, 1).cpu().numpy()
    shown = (targets.valid & targets.has_pose[:, None]).cpu().numpy()
    poses = targets.poses.double().cpu().numpy()
    size = images.shape[3], images.shape[2]
    cameras = [Camera(*size, *values) for values in targets.cameras.double().tolist()]
    fields = [_field(instances) for instances in targets.instances.cpu().numpy()]
    of_shafts = [
        part
        for picture, field, of_image, visible, camera in zip(
            pictures, fields, poses, shown, cameras, strict=True
        )
        for pose in of_image[visible]
        for part in _samples(np.ascontiguousarray(picture), field, pose, shaft, camera, rng)
    ]
    if not of_shafts:
        none = images.new_zeros(0, ROWS)
        return EdgeSamples(images.new_zeros(0, 3, ROWS, 2 * MIDDLE + 1), none, none > 0)
    colours, offsets, known = map(np.concatenate, zip(*of_shafts, strict=True))
    return EdgeSamples(
        torch.from_numpy(colours.transpose(0, 3, 1, 2)).to(images.device),
        torch.from_numpy(offsets).to(images.device),
        torch.from_numpy(known).to(images.device),
    )


def _field(instances: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """The pixels (H, W) inside the visible field, except those at its border."""
    outside = (instances == OUTSIDE).astype(np.uint8)
    return cv2.dilate(outside, np.ones((_BORDER_PX, _BORDER_PX), np.uint8)) == 0


def _samples(
    picture: NDArray[np.float32],
    field: NDArray[np.bool_],
    pose: Array,
    shaft: Shaft,
    camera: Camera,
    rng: np.random.Generator,
) -> Iterator[tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_]]]:
    """The colours, offsets and known rows of `EdgeSamples` at random outlines near one pose."""
    for _ in range(_OUTLINES):
        step_px = float(rng.uniform(*_STEP_PX))
        size = np.exp(rng.uniform(*np.log(_SIZES))) * step_px / _STEP_PX[1]
        contour = shaft_contour(
            moved(pose, size * rng.normal(size=5) * _SPREAD, camera), shaft, camera
        )
        if len(contour.points):
            strips = outline_strips(picture, contour, step_px)
            reach_px = (MIDDLE - _OUTERMOST) * step_px
            offsets = true_offsets(contour, pose, shaft, camera, reach_px)
            x, y = np.clip(contour.points, 0, [camera.width - 1, camera.height - 1]).astype(int).T
            known = strips.of_rows(strips.inside * field[y, x]) > 0
            yield strips.colours, strips.of_rows(offsets / step_px), known


def true_offsets(
    contour: Contour, pose: Array, shaft: Shaft, camera: Camera, reach_px: float
) -> Array:
    """Distances (N,) px from a contour's samples to the true outline along their normals.

    Positive outwards; plus or minus `reach_px` where the outline is further away. Searches outwards
    from samples inside the true silhouette, and inwards from others.
    """

    def inside(px: Array) -> NDArray[np.bool_]:
        """Whether places, (N, ...) px along the normals, are inside the true silhouette."""
        points = contour.points[:, None] + px[..., None] * contour.normals[:, None]
        return covered(points, pose, shaft, camera)

    outwards = np.where(inside(np.zeros((len(contour.points), 1))), 1.0, -1.0)
    places = outwards * reach_px * np.linspace(0, 1, _PLACES)
    crossed = inside(places) != (outwards > 0)
    crossed[:, -1] = True  # the furthest, if the outline is not nearer
    first = np.argmax(crossed, axis=1)[:, None]
    near, far = (np.take_along_axis(places, first - back, axis=1) for back in (1, 0))
    for _ in range(_HALVINGS):
        middle = (near + far) / 2
        before = inside(middle) == (outwards > 0)
        near, far = np.where(before, middle, near), np.where(before, far, middle)
    return np.asarray(far[:, 0])


def covered(pixels: Array, pose: Array, shaft: Shaft, camera: Camera) -> NDArray[np.bool_]:
    """Whether the rays through pixels (..., 2) of a pinhole camera meet a shaft with pose (5,)."""
    offsets = camera.lift(pixels, 1.0)
    rays = np.concatenate([offsets, np.ones_like(offsets[..., :1])], axis=-1)
    tip, axis, radius = pose[:3], axis_direction(pose[3], pose[4]), shaft.diameter_mm / 2
    along, start = rays @ axis, float(tip @ axis)
    across, aside = rays - along[..., None] * axis, tip - start * axis
    # |t across - aside|^2 = radius^2 for points at t along the ray.
    square, mixed = np.sum(across**2, axis=-1), across @ aside
    root = mixed**2 - square * (aside @ aside - radius**2)
    half = np.sqrt(np.maximum(root, 0.0))
    near, far = ((mixed + side * half) / square * along - start for side in (-1, 1))
    reached = np.maximum(near, far) >= 0
    return np.asarray(
        (root > 0) & (mixed > 0) & reached & (np.minimum(near, far) <= shaft.length_mm)
    )
