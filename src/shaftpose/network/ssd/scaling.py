"""Width and depth scaling of Inception-v4; 1.0 and 1.0 give the published network."""

BLOCKS = (4, 7, 3)  # Inception-A, B and C
STEM_CHANNELS = 32  # of the first convolution


def scale_channels(channels: int, width: float) -> int:
    """`channels` x `width`, rounded to a multiple of 4, at least 4; unchanged at width 1.0."""
    if width == 1.0:
        return channels
    return max(4, 4 * round(channels * width / 4))


def block_counts(depth: float) -> tuple[int, ...]:
    """Blocks of Inception-A, B and C at this depth: `BLOCKS` x `depth`, rounded."""
    return tuple(round(count * depth) for count in BLOCKS)
