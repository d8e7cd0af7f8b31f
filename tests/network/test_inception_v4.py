import torch
from torch import nn

from shaftpose.network.inception_v4 import MAP_SIZES, InceptionV4Features
from shaftpose.network.layers import scale_channels

# Of Inception-v4 as a classifier of 1,000 classes: convolutions without bias, weight and bias of
# each batch normalisation, and the last layer.
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

    What else differs has no parameters: padding 1 in Reduction-B makes its map 9 x 9 instead of
    8 x 8, and the pooling and dropout before the last layer are gone. The three stages to the
    smaller maps are new, and counted apart.
    """
    with torch.device("meta"):
        backbone = InceptionV4Features()
    assert parameters(backbone.trunk) == PUBLISHED_PARAMETERS - LAST_LAYER_PARAMETERS == 41_142_816
    # Each new stage: a 1 x 1 and a 3 x 3 convolution, batch normalisation behind both.
    new = [
        1536 * 256 + 2 * 256 + 9 * 256 * 512 + 2 * 512,
        512 * 128 + 2 * 128 + 9 * 128 * 256 + 2 * 256,
        256 * 128 + 2 * 128 + 9 * 128 * 256 + 2 * 256,
    ]
    assert sum(new) == 2_264_064
    assert parameters(backbone) == 41_142_816 + sum(new)


def parameters(module: nn.Module) -> int:
    return sum(weights.numel() for weights in module.parameters())


def test_narrow_network_says_its_channels() -> None:
    with torch.device("meta"):
        backbone = InceptionV4Features(0.3)
        maps = backbone(torch.zeros(1, 3, 299, 299))
    assert tuple(m.shape[1] for m in maps) == backbone.channels


def test_width_rounds_to_multiples_of_four() -> None:
    assert scale_channels(224, 0.25) == 56
    assert scale_channels(96, 0.3) == 28  # 28.8 lies nearer to 28 than to 32
    assert scale_channels(32, 0.01) == 4
    assert scale_channels(70, 1.0) == 70
