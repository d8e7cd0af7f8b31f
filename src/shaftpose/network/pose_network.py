"""The interface of a network, and the functions that all networks share.

Trainer, export and evaluation use nothing else of a network.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import Any, NamedTuple

import torch
from torch import Tensor, distributed, nn

from shaftpose.dataset.batches import Targets
from shaftpose.settings.schema import DetectionSettings

IMAGE_SIDE_PX = 299  # of the paper's networks
COUNTS = frozenset({"matched"})  # loss terms that are counts; all others are means


class DecodedOutputs(NamedTuple):
    """The instruments of a batch, best score first, padded with zeros.

    boxes: (B, K, 4) `x0, y0, x1, y1` in pixels; scores: (B, K); poses: (B, K, 5) mm, deg.
    """

    boxes: Tensor
    scores: Tensor
    poses: Tensor


class PoseNetwork(nn.Module, ABC):
    """A network with its loss and its decoding: images -> outputs -> loss terms or instruments.

    side_px: side of the training images; takes_any_size: whether other images, also rectangular
    ones, are taken as well; continuous: whether a small change of the outputs is a small change of
    the pose; needs_instances: whether targets must have `instances`.
    """

    side_px: int = IMAGE_SIDE_PX
    takes_any_size: bool = False
    continuous: bool = True
    needs_instances: bool = False

    def load_pretrained(self) -> None:
        """Load the weights that a training starts from, if the network has an encoder with some."""

    def pretrained(self) -> Iterable[nn.Parameter]:
        """The weights that `load_pretrained` loads."""
        return ()

    @abstractmethod
    def forward(self, images: Tensor) -> Any:
        """(B, 3, H, W) in [-1, 1] -> outputs, which only the other methods interpret."""

    @abstractmethod
    def loss_terms(self, outputs: Any, targets: Targets) -> dict[str, Tensor]:
        """Scalars by name: `loss`, which training minimises, and its terms."""

    @abstractmethod
    def detections(self, outputs: Any, limits: DetectionSettings) -> DecodedOutputs:
        """At most `limits.max_detections` instruments in each image."""


class MaskNetwork(PoseNetwork):
    """A network that also predicts the mask to which poses are fitted."""

    @abstractmethod
    def masks(self, outputs: Any) -> tuple[Tensor, Tensor]:
        """The probabilities of a shaft and of any part of an instrument, (B, H, W) in [0, 1]."""

    def edge_reader(self) -> nn.Module | None:
        """The network's reader of edges in strips (see `network.dense.edge_reader`), or None."""
        return None


def normalise_images(images: Tensor) -> Tensor:
    """(B, H, W, 3) uint8 RGB -> (B, 3, H, W) float in [-1, 1], channels last in memory."""
    pixels = images.permute(0, 3, 1, 2).float()
    return torch.add(-1.0, pixels, alpha=1 / 127.5)


def wrap_yaw(poses: Tensor) -> Tensor:
    """Poses (..., 5) with yaw in [0, 360) deg."""
    yaw = torch.remainder(poses[..., 4:], 360.0)
    # The remainder of a tiny negative angle is rounded to 360 itself.
    return torch.cat([poses[..., :4], torch.where(yaw >= 360.0, 0.0, yaw)], dim=-1)


def gather_rows(values: Tensor, rows: Tensor) -> Tensor:
    """values (B, M, K) at rows (B, N) int64 -> (B, N, K)."""
    return values.gather(1, rows[..., None].expand(-1, -1, values.shape[2]))


def rank_count() -> int:
    """The number of processes (ranks) of a distributed training; otherwise 1."""
    running = distributed.is_available() and distributed.is_initialized()
    return distributed.get_world_size() if running else 1


def sum_over_ranks(value: Tensor) -> Tensor:
    """The sum of a tensor over all ranks, the same on each; no gradient flows through it."""
    value = value.detach().clone()
    if rank_count() > 1:
        distributed.all_reduce(value)
    return value
