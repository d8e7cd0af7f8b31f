"""Scaled widths; cell centres, from the sizes of layers and, independently, from gradients."""

import pytest
import torch
from torch import nn

from shaftpose.network.ssd.inception_v4 import MAP_SIZES, InceptionV4Features
from shaftpose.network.ssd.layers import CellCentres, Concat, Pool, scale_channels, through


def test_layers_by_hand() -> None:
    assert through(nn.Conv2d(1, 1, 3, 2), CellCentres()) == CellCentres(1.5, 2.0)
    assert through(nn.Conv2d(1, 1, 3, 2, 1), CellCentres()) == CellCentres(0.5, 2.0)
    assert through(nn.MaxPool2d(2, 2), CellCentres(1.5, 2.0)) == CellCentres(2.5, 4.0)
    assert through(nn.Conv2d(1, 1, (1, 7), 1, (0, 3)), CellCentres(2.5, 4.0)) == CellCentres(
        2.5, 4.0
    )
    assert (
        through(nn.Sequential(nn.Conv2d(1, 1, 3), nn.Conv2d(1, 1, 3)), CellCentres()).first_px
        == 2.5
    )


def test_branches_must_agree() -> None:
    apart = Concat(Pool(nn.MaxPool2d(3, 2), 1), Pool(nn.MaxPool2d(1, 2), 1))
    with pytest.raises(ValueError, match="unpack"):
        through(apart, CellCentres())


def test_centres_by_hand() -> None:
    """The unpadded stem: 17 cells of 8 px on either side of the middle of 299 px."""
    centres = InceptionV4Features(0.25, 0.25).cell_centres()
    assert [len(along) for along in centres] == list(MAP_SIZES)
    expected = [(149.5 + 8 * (cell - 17)) / 299 for cell in range(35)]
    assert centres[0] == pytest.approx(expected)
    assert centres[1] == pytest.approx([(149.5 + 16 * (cell - 8)) / 299 for cell in range(17)])
    assert centres[5] == pytest.approx([21.5 / 299, 277.5 / 299])


@pytest.mark.parametrize(("level", "cell"), [(0, 8), (0, 17), (0, 25), (1, 5), (1, 8), (2, 4)])
def test_gradients_lie_where_the_cell_is_said_to_be(level: int, cell: int) -> None:
    """The centroid of |d cell / d image|, without cells whose receptive field the border cuts."""
    torch.manual_seed(3)
    backbone = InceptionV4Features(0.25, 0.25).eval()
    image = torch.rand(4, 3, 299, 299, requires_grad=True)
    features = backbone(image)[level]
    row = features.shape[2] // 2
    (gradient,) = torch.autograd.grad(features[:, :, row, cell].sum(), image)
    weight = gradient.abs().sum(dim=(0, 1))
    pixels = torch.arange(299) + 0.5
    x = float((weight.sum(dim=0) * pixels).sum() / weight.sum())
    y = float((weight.sum(dim=1) * pixels).sum() / weight.sum())
    centres = backbone.cell_centres()[level]
    assert x == pytest.approx(centres[cell] * 299, abs=2.0)
    assert y == pytest.approx(centres[row] * 299, abs=2.0)


def test_width_rounds_to_multiples_of_four() -> None:
    assert scale_channels(224, 0.25) == 56
    assert scale_channels(96, 0.3) == 28  # 28.8 is closer to 28 than to 32
    assert scale_channels(32, 0.01) == 4
    assert scale_channels(70, 1.0) == 70
