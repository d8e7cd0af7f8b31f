"""Independent random streams of one seed, each with a name."""

from collections.abc import Callable
from zlib import crc32

import numpy as np

Streams = Callable[[str], np.random.Generator]


def streams(*seed: int) -> Streams:
    """A function from a name to a generator, which depends on the seed and the name alone.

    Each call starts the stream of its name from the beginning. Each random quantity has its own
    name, so that adding or removing one draw leaves all others unchanged; streams spawned by
    position would shift.
    """

    def stream(name: str) -> np.random.Generator:
        # A checksum, because Python's hash of a string differs between processes.
        key = crc32(name.encode())
        return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(key,)))

    return stream
