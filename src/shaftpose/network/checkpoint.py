"""Loading trained weights into the network they belong to."""

import pickle
from pathlib import Path
from typing import Any

import torch

from shaftpose.errors import InputError
from shaftpose.network.shaft_network import ShaftNetwork

WEIGHT_PREFIX = "network."  # the network's name in `ShaftModule`


def load_network_weights(
    path: Path, network: ShaftNetwork, identity: dict[str, str | float]
) -> None:
    """Fill `network` with the weights of a training checkpoint written with this `identity`."""
    checkpoint = _read_checkpoint(path)
    found = checkpoint["identity"]
    if found != identity:
        raise InputError(
            f"{path}: holds the weights of {found}, not of {identity}; "
            "train this network, or choose the checkpoint's variant and width"
        )
    weights = {
        name.removeprefix(WEIGHT_PREFIX): value
        for name, value in checkpoint["state_dict"].items()
        if name.startswith(WEIGHT_PREFIX)
    }
    try:
        network.load_state_dict(weights)
    except RuntimeError as error:
        raise InputError(
            f"{path}: its weights do not fit this version of {identity}; train it again"
        ) from error


def _read_checkpoint(path: Path) -> dict[str, Any]:
    if not path.is_file():
        raise InputError(f"{path}: no such checkpoint; train the network first")
    try:
        checkpoint = torch.load(path, map_location="cpu", weights_only=True)
    except (OSError, EOFError, RuntimeError, pickle.UnpicklingError) as error:
        raise InputError(f"{path}: not a readable checkpoint; train the network again") from error
    if not isinstance(checkpoint, dict) or not {"identity", "state_dict"} <= checkpoint.keys():
        raise InputError(f"{path}: not a checkpoint of this project; train the network again")
    return checkpoint
