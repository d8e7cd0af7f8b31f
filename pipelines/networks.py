"""The network of a variant, as train, export and evaluation need it alike."""

from pathlib import Path

from hydra.utils import instantiate
from settings import parse_variant, size
from stage import Config

from shaftpose.config import PoseRanges, Variant, parse
from shaftpose.network.checkpoint import load_network_weights, start_from_detector
from shaftpose.network.shaft_network import ShaftNetwork


def variant(config: Config) -> Variant:
    """What distinguishes the chosen variant. Raises InputError if its file is wrong."""
    return parse_variant(config["variant"], config["variant_file"])


def identity(config: Config) -> dict[str, str | float]:
    """What a checkpoint must agree in with the network that loads it."""
    return {"variant": variant(config).name, **_backbone(config)}


def _backbone(config: Config) -> dict[str, float]:
    sizes = size(config)
    return {"width": sizes.width, "depth": sizes.depth}


def initial_network(config: Config) -> ShaftNetwork:
    """The network as a training begins: random weights, or those of the detector at `start`."""
    network, start = build_network(config), variant(config).start
    if start is not None:
        start_from_detector(start, network, _backbone(config))
    return network


def build_network(config: Config) -> ShaftNetwork:
    """The untrained network of the chosen variant, width and depth."""
    ranges = parse(PoseRanges, config["poses"], "params.yaml: poses")
    return ShaftNetwork(
        backbone=instantiate(config["backbone"]),
        head=instantiate(config["variant"]["head"]),
        pose_coder=instantiate(config["variant"]["pose_coder"])(ranges.low, ranges.high),
    )


def trained_network(config: Config, checkpoint: Path) -> ShaftNetwork:
    """The network with the weights of a checkpoint. Raises InputError if it does not hold them."""
    network = build_network(config)
    load_network_weights(checkpoint, network, identity(config))
    return network.eval()
