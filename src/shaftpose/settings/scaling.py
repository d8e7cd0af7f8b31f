"""Width and depth scaling of Inception-v4; 1.0 and 1.0 give the published network.

Imports no torch, so that settings can be checked early.
"""

from shaftpose.core.errors import InputError

BLOCKS = (4, 7, 3)  # Inception-A, B and C
STEM_CHANNELS = 32  # of the first convolution
LEAST_STEM_CHANNELS = 8  # fewer carry too little of the image to learn from


def scale_channels(channels: int, width: float) -> int:
    """`channels` x `width`, rounded to a multiple of 4, at least 4; unchanged at width 1.0."""
    if width == 1.0:
        return channels
    return max(4, 4 * round(channels * width / 4))


def check_width(width: float) -> None:
    """Raise InputError if the stem's first convolution has too few channels at this width."""
    channels = scale_channels(STEM_CHANNELS, width)
    if channels < LEAST_STEM_CHANNELS:
        raise InputError(
            f"width = {width:g} gives the first convolution {channels} channels, fewer than "
            f"{LEAST_STEM_CHANNELS}; {LEAST_STEM_CHANNELS / STEM_CHANNELS:g} gives enough"
        )


def block_counts(depth: float) -> tuple[int, ...]:
    """Blocks of Inception-A, B and C at this depth: `BLOCKS` x `depth`, rounded.

    Raises InputError if a stage would have none.
    """
    counts = tuple(round(count * depth) for count in BLOCKS)
    if not all(counts):
        raise InputError(
            f"depth = {depth:g} gives the three stages {counts} blocks, but each needs at least "
            "one; 0.25 gives 1, 2 and 1"
        )
    return counts
