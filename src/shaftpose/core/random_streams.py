"""Random streams with names."""

from collections.abc import Callable
from zlib import crc32

import numpy as np

Streams = Callable[[str], np.random.Generator]


def streams(*seed: int) -> Streams:
    """The independent random streams of one seed: name -> generator, at the stream's start.

    Each thing that is drawn at random has a stream of its own name. Adding or removing one thus
    leaves the draws of all others unchanged; streams spawned by position would shift.
    """

    def stream(name: str) -> np.random.Generator:
        # A checksum, because Python's hash of a string differs between processes.
        key = crc32(name.encode())
        return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(key,)))

    return stream
