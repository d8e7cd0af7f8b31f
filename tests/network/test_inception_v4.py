import torch

from shaftpose.network.inception_v4 import MAP_SIZES, InceptionV4Features
from shaftpose.network.layers import scale_channels

# The published classifier has 42,679,816 parameters, 1536 x 1000 + 1000 of them in its last layer.
PUBLISHED_TRUNK_PARAMETERS = 41_142_816


def test_maps_of_the_full_network() -> None:
    with torch.device("meta"):
        backbone = InceptionV4Features()
        maps = backbone(torch.zeros(2, 3, 299, 299))
    assert backbone.channels == (384, 1024, 1536, 512, 256, 256)
    expected = [(2, c, s, s) for c, s in zip(backbone.channels, MAP_SIZES, strict=True)]
    assert [tuple(m.shape) for m in maps] == expected


def test_trunk_has_as_many_parameters_as_the_published_network() -> None:
    with torch.device("meta"):
        backbone = InceptionV4Features()
    assert sum(p.numel() for p in backbone.trunk.parameters()) == PUBLISHED_TRUNK_PARAMETERS


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
