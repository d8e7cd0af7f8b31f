"""Reading checkpoints of finished and unfinished trainings."""

import pickle
from collections.abc import Set
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import torch
from torch import Tensor

from shaftpose.core.errors import InputError
from shaftpose.network.pose_network import PoseNetwork

# A checkpoint and the network that loads it must agree in these: variant and, with the paper's
# backbone, width and depth.
Identity = dict[str, str | float]

WEIGHT_PREFIX = "network."  # the network's name in `ShaftModule`
_OF_POSES = ("head.pose", "pose_coder.")  # prefixes of the weights that a detector does not learn
_ANOTHER_START = (
    "train a detector of this size with `variant=detector` and the same settings, or append "
    "`variant.start=null` to start from random weights"
)

_AGAIN = "delete it and train the network again"


def load_network_weights(path: Path, network: PoseNetwork, identity: Identity) -> None:
    """Load the weights of a training checkpoint with this `identity` into `network`.

    Raises InputError if the file does not hold them.
    """
    checkpoint = _read_checkpoint_of(path, identity, {"state_dict"})
    try:
        network.load_state_dict(_network_weights(checkpoint))
    except RuntimeError as error:
        raise InputError(
            f"{path}: its weights do not fit this version's network {identity}; {_AGAIN}"
        ) from error


def start_from_detector(path: Path, network: PoseNetwork, identity: dict[str, float]) -> None:
    """Load the weights of a trained detector into `network`, except those of poses.

    identity: width and depth, in which both must agree. Raises InputError if the file does not hold
    these weights.
    """
    checkpoint = _read_checkpoint(path, {"state_dict"})
    other = {name: checkpoint["identity"].get(name) for name in identity}
    if other != identity:
        raise InputError(f"{path}: holds a network of {other}, not of {identity}; {_ANOTHER_START}")
    weights = {
        name: value
        for name, value in _network_weights(checkpoint).items()
        if not name.startswith(_OF_POSES)
    }
    own = {name for name in network.state_dict() if not name.startswith(_OF_POSES)}
    if different := sorted(own ^ weights.keys()):
        raise InputError(f"{path}: {different[0]} is not in both networks; {_ANOTHER_START}")
    try:
        network.load_state_dict(weights, strict=False)
    except RuntimeError as error:
        raise InputError(f"{path}: weights of other shapes; {_ANOTHER_START}") from error


def identity_of(path: Path) -> Identity:
    """The identity of the network whose weights a checkpoint holds.

    Raises InputError if the file is not a checkpoint.
    """
    return dict(_read_checkpoint(path, {"state_dict"})["identity"])


def resumed_step(path: Path, identity: Identity) -> int:
    """The step at which a training resumes from a checkpoint.

    Raises InputError if the file holds no unfinished training of a network of this `identity`.
    """
    parts = {"state_dict", "optimizer_states", "lr_schedulers", "loops", "global_step"}
    return int(_read_checkpoint_of(path, identity, parts)["global_step"])


def is_intact(path: Path) -> bool:
    """Whether a checkpoint's bytes are those that were written: torch stores a checksum of each of
    its parts, but does not compare it."""
    try:
        with ZipFile(path) as archive:
            return archive.testzip() is None
    except Exception:  # of any kind: damaged sizes, names and methods are met before checksums
        return False


def _read_checkpoint_of(path: Path, identity: Identity, parts: Set[str]) -> dict[str, Any]:
    """Read a checkpoint of this identity that has these parts."""
    checkpoint = _read_checkpoint(path, parts)
    if checkpoint["identity"] != identity:
        raise InputError(
            f"{path}: holds the weights of {checkpoint['identity']}, not of {identity}; "
            f"{_AGAIN}, or choose the checkpoint's variant, width and depth"
        )
    return checkpoint


def _read_checkpoint(path: Path, parts: Set[str]) -> dict[str, Any]:
    """Read a checkpoint that has these parts, without running code from it."""
    if not path.is_file():
        raise InputError(f"{path}: no such checkpoint; train the network first")
    if not is_intact(path):
        raise InputError(f"{path}: not a readable checkpoint, or damaged; {_AGAIN}")
    try:
        checkpoint = torch.load(path, map_location="cpu", weights_only=True)
    except (OSError, EOFError, RuntimeError, pickle.UnpicklingError) as error:
        raise InputError(f"{path}: not a readable checkpoint; {_AGAIN}") from error
    if not isinstance(checkpoint, dict) or not {"identity"} | parts <= checkpoint.keys():
        raise InputError(f"{path}: not a checkpoint of this project; {_AGAIN}")
    return checkpoint


def _network_weights(checkpoint: dict[str, Any]) -> dict[str, Tensor]:
    """The network's weights and buffers in a checkpoint, by their names in the network."""
    return {
        name.removeprefix(WEIGHT_PREFIX): value
        for name, value in checkpoint["state_dict"].items()
        if name.startswith(WEIGHT_PREFIX)
    }
