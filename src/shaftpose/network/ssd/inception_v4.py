"""Inception-v4 (Szegedy et al., 2016), extended to the six feature maps of an SSD detector.

At width and depth 1.0 all convolutions up to the third map match the published layer table. Two
changes follow the paper on shaft poses: Reduction-B is padded, so that its map is 9 x 9 instead of
8 x 8, and three more stages lead down to 2 x 2.
"""

from collections.abc import Callable

from torch import Tensor, nn

from shaftpose.network.pose_network import IMAGE_SIDE_PX
from shaftpose.network.ssd.layers import (
    CellCentres,
    Chain,
    Concat,
    Conv,
    Fork,
    Pool,
    PooledChain,
    scale_channels,
    through,
)

MAP_SIZES = (35, 17, 9, 5, 3, 2)
EXTRA_CHANNELS = (512, 256, 256)
BLOCKS = (4, 7, 3)  # Inception-A, B and C


def stem(width: float) -> nn.Sequential:
    """(B, 3, 299, 299) -> (B, 384, 35, 35)."""
    first = Chain(3, width, Conv(32, 3, 2, 0), Conv(32, 3, 1, 0), Conv(64, 3))
    second = Concat(
        _max_pool(first.channels, padding=0), Chain(first.channels, width, Conv(96, 3, 2, 0))
    )
    third = Concat(
        Chain(second.channels, width, Conv(64, 1), Conv(96, 3, 1, 0)),
        Chain(
            second.channels, width,
            Conv(64, 1), Conv(64, (7, 1)), Conv(64, (1, 7)), Conv(96, 3, 1, 0),
        ),
    )  # fmt: skip
    fourth = Concat(
        Chain(third.channels, width, Conv(192, 3, 2, 0)), _max_pool(third.channels, padding=0)
    )
    return nn.Sequential(first, second, third, fourth)


def inception_a(channels: int, width: float) -> Concat:
    """(B, 384, 35, 35) -> (B, 384, 35, 35)."""
    return Concat(
        PooledChain(channels, width, Conv(96, 1)),
        Chain(channels, width, Conv(96, 1)),
        Chain(channels, width, Conv(64, 1), Conv(96, 3)),
        Chain(channels, width, Conv(64, 1), Conv(96, 3), Conv(96, 3)),
    )


def reduction_a(channels: int, width: float) -> Concat:
    """(B, 384, 35, 35) -> (B, 1024, 17, 17), with k, l, m, n = 192, 224, 256, 384."""
    return Concat(
        _max_pool(channels, padding=0),
        Chain(channels, width, Conv(384, 3, 2, 0)),
        Chain(channels, width, Conv(192, 1), Conv(224, 3), Conv(256, 3, 2, 0)),
    )


def inception_b(channels: int, width: float) -> Concat:
    """(B, 1024, 17, 17) -> (B, 1024, 17, 17)."""
    return Concat(
        PooledChain(channels, width, Conv(128, 1)),
        Chain(channels, width, Conv(384, 1)),
        Chain(channels, width, Conv(192, 1), Conv(224, (1, 7)), Conv(256, (7, 1))),
        Chain(
            channels, width,
            Conv(192, 1), Conv(192, (1, 7)), Conv(224, (7, 1)),
            Conv(224, (1, 7)), Conv(256, (7, 1)),
        ),
    )  # fmt: skip


def reduction_b(channels: int, width: float) -> Concat:
    """(B, 1024, 17, 17) -> (B, 1536, 9, 9): padded by 1, unlike the classifier."""
    return Concat(
        _max_pool(channels, padding=1),
        Chain(channels, width, Conv(192, 1), Conv(192, 3, 2, 1)),
        Chain(
            channels, width,
            Conv(256, 1), Conv(256, (1, 7)), Conv(320, (7, 1)), Conv(320, 3, 2, 1),
        ),
    )  # fmt: skip


def inception_c(channels: int, width: float) -> Concat:
    """(B, 1536, 9, 9) -> (B, 1536, 9, 9)."""
    short = Chain(channels, width, Conv(384, 1))
    long = Chain(channels, width, Conv(384, 1), Conv(448, (1, 3)), Conv(512, (3, 1)))
    return Concat(
        PooledChain(channels, width, Conv(256, 1)),
        Chain(channels, width, Conv(256, 1)),
        Fork(short, width, Conv(256, (1, 3)), Conv(256, (3, 1))),
        Fork(long, width, Conv(256, (3, 1)), Conv(256, (1, 3))),
    )


class InceptionV4Features(nn.Module):
    """The backbone: six feature maps of sizes `MAP_SIZES` with `channels` channels each.

    `width` multiplies the channels of every convolution, `depth` the number of Inception blocks;
    1.0 and 1.0 are the published network.
    """

    def __init__(self, width: float = 1.0, depth: float = 1.0) -> None:
        super().__init__()
        self.width = width
        a_count, b_count, c_count = block_counts(depth)
        first = stem(width)
        a_blocks = _repeat(inception_a, a_count, _channels(first), width)
        to_17 = reduction_a(_channels(a_blocks), width)
        b_blocks = _repeat(inception_b, b_count, to_17.channels, width)
        to_9 = reduction_b(_channels(b_blocks), width)
        c_blocks = _repeat(inception_c, c_count, to_9.channels, width)
        self.trunk = nn.ModuleList(
            [
                nn.Sequential(first, a_blocks),
                nn.Sequential(to_17, b_blocks),
                nn.Sequential(to_9, c_blocks),
            ]
        )
        self.extra = _extra_stages(_channels(c_blocks), width)
        self.channels: tuple[int, ...] = (
            *(_channels(blocks) for blocks in (a_blocks, b_blocks, c_blocks)),
            *(scale_channels(channels, width) for channels in EXTRA_CHANNELS),
        )

    def forward(self, images: Tensor) -> list[Tensor]:
        """(B, 3, 299, 299) -> six maps (B, channels[i], MAP_SIZES[i], MAP_SIZES[i])."""
        maps, x = [], images
        for stage in (*self.trunk, *self.extra):
            x = stage(x)
            maps.append(x)
        return maps

    def cell_centres(self) -> list[list[float]]:
        """Cell centres of each map along either axis, in units of the image's side."""
        centres, cells = [], CellCentres()
        for size, stage in zip(MAP_SIZES, (*self.trunk, *self.extra), strict=True):
            cells = through(stage, cells)
            centres.append([cells.centre_px(cell) / IMAGE_SIDE_PX for cell in range(size)])
        return centres


def block_counts(depth: float) -> tuple[int, ...]:
    """Blocks of Inception-A, B and C at this depth: `BLOCKS` x `depth`, rounded."""
    return tuple(round(count * depth) for count in BLOCKS)


def _repeat(
    block: Callable[[int, float], Concat], count: int, channels: int, width: float
) -> nn.Sequential:
    """`count` blocks in a row; the first one may change the number of channels when scaled."""
    blocks = nn.Sequential()
    for _ in range(count):
        blocks.append(block(channels, width))
        channels = _channels(blocks)
    return blocks


def _extra_stages(channels: int, width: float) -> nn.ModuleList:
    """SSD's extra stages: a 1 x 1 bottleneck of half the channels, then 3 x 3 with stride 2."""
    stages = nn.ModuleList()
    for count in EXTRA_CHANNELS:
        stage = Chain(channels, width, Conv(count // 2, 1), Conv(count, 3, 2, 1))
        stages.append(stage)
        channels = stage.channels
    return stages


def _max_pool(channels: int, padding: int) -> Pool:
    return Pool(nn.MaxPool2d(3, 2, padding), channels)


def _channels(blocks: nn.Sequential) -> int:
    """The output channels of a sequence's last block."""
    last = blocks[-1]
    assert isinstance(last, Concat)
    return last.channels
