"""Sums over the processes (ranks) of a distributed training; otherwise there is one rank."""

from torch import Tensor, distributed


def count() -> int:
    """The number of ranks."""
    running = distributed.is_available() and distributed.is_initialized()
    return distributed.get_world_size() if running else 1


def total(value: Tensor) -> Tensor:
    """The sum of a tensor over all ranks, the same on each; no gradient flows through it."""
    value = value.detach().clone()
    if count() > 1:
        distributed.all_reduce(value)
    return value
