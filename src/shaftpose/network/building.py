"""Building a variant's network from its file."""

from functools import partial
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from shaftpose.core.errors import InputError
from shaftpose.network.checkpoint import Identity, load_network_weights, start_from_detector
from shaftpose.network.pose_network import PoseNetwork
from shaftpose.settings.schema import Variant


def identity(variant: Variant) -> Identity:
    """The values in which a checkpoint and the network that loads it must agree."""
    return {"variant": variant.name, **scale(variant)}


def scale(variant: Variant) -> dict[str, float]:
    """Width and depth of the paper's backbone; nothing for networks without it."""
    backbone = variant.network.get("backbone", {})
    return {name: backbone[name] for name in ("width", "depth") if name in backbone}


def build_network(variant: Variant) -> PoseNetwork:
    """Build the untrained network that a variant's file describes, with its loss.

    Raises InputError naming the file if an argument there is wrong.
    """
    try:
        network: PoseNetwork = built({**variant.network, "loss": variant.loss})
    except (ImportError, AttributeError, TypeError, ValueError) as error:
        reason = " ".join(str(error).split())  # may have several lines
        raise InputError(f"conf/variant/{variant.name}.yaml: {reason}") from error
    return network


def built(described: Any) -> Any:
    """The object that a class or function, `_target_`, makes of its arguments, which are described
    alike; other values as they are. With `_partial_`, the call that is still to be made."""
    if not isinstance(described, dict):
        return described
    values = {name: built(value) for name, value in described.items()}
    if "_target_" not in values:
        return values
    target, waits = resolve_name(values.pop("_target_")), values.pop("_partial_", False)
    return partial(target, **values) if waits else target(**values)


def initial_network(variant: Variant) -> PoseNetwork:
    """The network at the start of a training: random weights, an encoder's pretrained ones, or the
    detector's at `start`."""
    network = build_network(variant)
    network.load_pretrained()
    if variant.start is not None:
        start_from_detector(variant.start, network, scale(variant))
    return network


def trained_network(variant: Variant, checkpoint: Path) -> PoseNetwork:
    """The network with the weights of a checkpoint. Raises InputError if they cannot be loaded."""
    network = build_network(variant)
    load_network_weights(checkpoint, network, identity(variant))
    return network.eval()
