import pytest
import torch
from torch import Tensor, nn

from shaftpose.network.ssd.default_boxes import BOXES_PER_CELL
from shaftpose.network.ssd.heads import ArchitectureC, ArchitectureD, flatten_maps
from shaftpose.network.ssd.inception_v4 import MAP_SIZES
from tests.network.ssd.even_boxes import even_boxes

CHANNELS = (4, 4, 4, 4, 4, 4)


def random_features() -> list[Tensor]:
    generator = torch.Generator().manual_seed(0)
    return [torch.randn(2, 4, size, size, generator=generator) for size in MAP_SIZES]


Head = type[ArchitectureC] | type[ArchitectureD]


@pytest.mark.parametrize("pose_values", [5, 190])
@pytest.mark.parametrize("head_class", [ArchitectureC, ArchitectureD])
def test_shapes(head_class: Head, pose_values: int) -> None:
    outputs = head_class(CHANNELS, BOXES_PER_CELL, 0.1, pose_values)(random_features())
    assert outputs.class_logits.shape == (2, 7322, 2)
    assert outputs.box_offsets.shape == (2, 7322, 4)
    assert outputs.poses.shape == (2, 7322, pose_values)


def coordinate_map(index: int, size: int) -> Tensor:
    """(1, N * 3, size, size): each box's column, row and map, the three values of its place."""
    steps = (torch.arange(size) + 0.5) / size
    cy, cx = torch.meshgrid(steps, steps, indexing="ij")
    place = torch.stack([cx, cy, torch.full_like(cx, index)])
    return place.repeat(BOXES_PER_CELL[index], 1, 1)[None]


def test_order_of_cells_is_that_of_the_default_boxes() -> None:
    flat = flatten_maps([coordinate_map(i, size) for i, size in enumerate(MAP_SIZES)], 3)[0]
    torch.testing.assert_close(flat[:, :2], even_boxes()[:, :2])
    assert torch.equal(flat[:, 2], flat[:, 2].sort().values)


def test_order_of_boxes_in_a_cell_is_that_of_the_default_boxes() -> None:
    """With a cell's default box sizes as biases, the convolutions return all default boxes."""
    head = ArchitectureC(CHANNELS, BOXES_PER_CELL, 1.0, pose_values=5)
    defaults, start = even_boxes(), 0
    for conv, size, boxes in zip(head.box_convs, MAP_SIZES, BOXES_PER_CELL, strict=True):
        assert isinstance(conv, nn.Conv2d) and conv.bias is not None
        nn.init.zeros_(conv.weight)
        conv.bias.data = defaults[start : start + boxes].reshape(-1).clone()
        start += size * size * boxes
    offsets = head(random_features()).box_offsets
    torch.testing.assert_close(offsets[..., 2:], defaults[:, 2:].expand(2, -1, -1))


@pytest.mark.parametrize(
    ("head_class", "depends"),
    [(ArchitectureC, False), (ArchitectureD, True)],
)
def test_only_d_feeds_class_and_box_into_the_pose(head_class: Head, depends: bool) -> None:
    torch.manual_seed(0)
    head = head_class(CHANNELS, BOXES_PER_CELL, 0.1, pose_values=5)
    head(random_features()).poses.square().sum().backward()
    for conv in (*head.class_convs, *head.box_convs):
        assert (conv.weight.grad is not None and bool(conv.weight.grad.any())) == depends
