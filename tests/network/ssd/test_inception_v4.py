from typing import get_type_hints

import pytest
import torch
from pydantic import TypeAdapter, ValidationError
from torch import nn

from shaftpose.network.ssd.inception_v4 import MAP_SIZES, InceptionV4Features, block_counts
from shaftpose.network.ssd.layers import scale_channels
from shaftpose.settings.schema import RunSize

# Inception-v4 as a classifier of 1,000 classes: convolutions without bias, weight and bias of each
# batch normalisation, and the last layer.
PUBLISHED_PARAMETERS = 42_679_816
LAST_LAYER_PARAMETERS = 1536 * 1000 + 1000


def test_maps_of_the_full_network() -> None:
    with torch.device("meta"):
        backbone = InceptionV4Features()
        maps = backbone(torch.zeros(2, 3, 299, 299))
    assert backbone.channels == (384, 1024, 1536, 512, 256, 256)
    expected = [(2, c, s, s) for c, s in zip(backbone.channels, MAP_SIZES, strict=True)]
    assert [tuple(m.shape) for m in maps] == expected


def test_trunk_has_as_many_parameters_as_the_published_network() -> None:
    """The trunk, up to the third map, is the classifier without its last layer.

    The other differences have no parameters: padding 1 in Reduction-B makes its map 9 x 9 instead
    of 8 x 8, and the pooling and dropout before the last layer are gone. The three stages to the
    smaller maps are new, and counted separately.
    """
    with torch.device("meta"):
        backbone = InceptionV4Features()
    assert parameters(backbone.trunk) == PUBLISHED_PARAMETERS - LAST_LAYER_PARAMETERS == 41_142_816
    # Each new stage: a 1 x 1 and a 3 x 3 convolution, each with batch normalisation.
    new = [
        1536 * 256 + 2 * 256 + 9 * 256 * 512 + 2 * 512,
        512 * 128 + 2 * 128 + 9 * 128 * 256 + 2 * 256,
        256 * 128 + 2 * 128 + 9 * 128 * 256 + 2 * 256,
    ]
    assert sum(new) == 2_264_064
    assert parameters(backbone) == 41_142_816 + sum(new)


def parameters(module: nn.Module) -> int:
    return sum(weights.numel() for weights in module.parameters())


@pytest.mark.parametrize(("width", "depth"), [(0.3, 1.0), (0.25, 0.25)])
def test_narrow_and_shallow_networks_say_their_channels(width: float, depth: float) -> None:
    with torch.device("meta"):
        backbone = InceptionV4Features(width, depth)
        maps = backbone(torch.zeros(1, 3, 299, 299))
    assert tuple(m.shape[1] for m in maps) == backbone.channels


def test_depth_leaves_out_blocks_and_nothing_else() -> None:
    """It leaves out three Inception-A, five B and two C; blocks of a kind are equal at width 1."""
    with torch.device("meta"):
        full, shallow = InceptionV4Features(), InceptionV4Features(depth=0.25)
    assert shallow.channels == full.channels
    blocks = [parameters(stage.get_submodule("1.0")) for stage in full.trunk]
    left_out = sum(n * count for n, count in zip(blocks, (3, 5, 2), strict=True))
    assert parameters(full) - parameters(shallow) == left_out


@pytest.mark.parametrize(
    ("depth", "blocks"),
    [(1.0, (4, 7, 3)), (0.25, (1, 2, 1)), (0.5, (2, 4, 2)), (2.0, (8, 14, 6))],
)
def test_depth_scales_the_blocks(depth: float, blocks: tuple[int, ...]) -> None:
    assert block_counts(depth) == blocks


def test_the_least_sizes_of_the_settings_give_a_network_that_can_learn() -> None:
    width, depth = (get_type_hints(RunSize, include_extras=True)[key] for key in ("width", "depth"))
    assert scale_channels(32, TypeAdapter(width).validate_python(0.1875)) == 8
    assert block_counts(TypeAdapter(depth).validate_python(0.17)) == (1, 1, 1)
    assert scale_channels(32, 0.187) < 8 and 0 in block_counts(0.16)
    for kind, less in ((width, 0.187), (depth, 0.16)):
        with pytest.raises(ValidationError):
            TypeAdapter(kind).validate_python(less)
