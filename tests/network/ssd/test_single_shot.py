import pytest
import torch

from shaftpose.network.ssd.default_boxes import to_corners
from shaftpose.network.ssd.single_shot import SingleShotNetwork


def test_outputs_have_one_row_per_default_box(tiny_network: SingleShotNetwork) -> None:
    with torch.no_grad():
        outputs = tiny_network.eval()(torch.zeros(1, 3, 299, 299))
    assert [tuple(output.shape) for output in outputs] == [
        (1, len(tiny_network.defaults), values) for values in (2, 4, 5)
    ]


def test_default_boxes_lie_where_cells_look_and_end_at_the_border(
    tiny_network: SingleShotNetwork,
) -> None:
    corners = to_corners(tiny_network.defaults)
    assert corners.min() >= 0 and corners.max() <= 1 + 1e-6
    middle = 4 * (17 * 35 + 17)  # the first box of the cell in the middle of the first map
    torch.testing.assert_close(tiny_network.defaults[middle], torch.tensor([0.5, 0.5, 0.1, 0.1]))
    beside = tiny_network.defaults[middle + 4]  # one cell of 8 px to the right
    assert beside[0].item() == pytest.approx((149.5 + 8) / 299)
    # The first cell's centre is at 13.5 px; a box of 29.9 px there ends at the border.
    assert corners[0].tolist() == pytest.approx([0, 0, 28.45 / 299, 28.45 / 299])
