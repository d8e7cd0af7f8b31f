"""Building a variant's network from its settings."""

from dataclasses import dataclass
from pathlib import Path

from hydra.utils import instantiate

from shaftpose.network.checkpoint import Identity, load_network_weights, start_from_detector
from shaftpose.network.pose_network import PoseNetwork
from shaftpose.settings.schema import CameraSettings, LossSettings, PoseRanges, Size, Variant


def identity(variant: Variant, size: Size) -> Identity:
    """The values in which a checkpoint and the network that loads it must agree."""
    return {"variant": variant.name, "width": size.width, "depth": size.depth}


@dataclass(frozen=True)
class NetworkSettings:
    """The settings that a network is built from."""

    variant: Variant
    size: Size
    camera: CameraSettings
    poses: PoseRanges
    loss: LossSettings


def build_network(settings: NetworkSettings) -> PoseNetwork:
    """Build the untrained network named by `variant.network` from the other settings."""
    network: PoseNetwork = instantiate(settings.variant.network)(
        size=settings.size, camera=settings.camera, poses=settings.poses, loss=settings.loss
    )
    return network


def initial_network(settings: NetworkSettings) -> PoseNetwork:
    """The network at the start of a training: random weights, or the detector's at `start`."""
    network, start, size = build_network(settings), settings.variant.start, settings.size
    if start is not None:
        start_from_detector(start, network, {"width": size.width, "depth": size.depth})
    return network


def trained_network(settings: NetworkSettings, checkpoint: Path) -> PoseNetwork:
    """The network with the weights of a checkpoint. Raises InputError if they cannot be loaded."""
    network = build_network(settings)
    load_network_weights(checkpoint, network, identity(settings.variant, settings.size))
    return network.eval()
