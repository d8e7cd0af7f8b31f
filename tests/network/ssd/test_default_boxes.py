import pytest
import torch

from shaftpose.network.ssd.boxes import to_centre, to_corners
from shaftpose.network.ssd.default_boxes import BOXES_PER_CELL, clipped
from tests.network.ssd.even_boxes import even_boxes


def test_count() -> None:
    assert BOXES_PER_CELL == (4, 6, 6, 6, 4, 4)
    assert even_boxes().shape == (7322, 4)


def test_first_cell_by_hand() -> None:
    centre = 0.5 / 35
    sizes = [
        (0.1, 0.1),
        (0.1 * 2**0.5, 0.1 * 2**0.5),  # sqrt(30 * 60) / 300
        (0.1 * 2**0.5, 0.1 / 2**0.5),
        (0.1 / 2**0.5, 0.1 * 2**0.5),
    ]
    expected = torch.tensor([(centre, centre, w, h) for w, h in sizes])
    torch.testing.assert_close(even_boxes()[:4], expected)


def test_columns_come_before_rows() -> None:
    boxes = even_boxes()
    assert boxes[4, :2].tolist() == pytest.approx([1.5 / 35, 0.5 / 35])
    assert boxes[4 * 35, :2].tolist() == pytest.approx([0.5 / 35, 1.5 / 35])


def test_second_map_has_ratio_three() -> None:
    box = even_boxes()[4 * 35 * 35 + 4]
    expected = [0.5 / 17, 0.5 / 17, 0.2 * 3**0.5, 0.2 / 3**0.5]
    assert box.tolist() == pytest.approx(expected)


def test_last_box_by_hand() -> None:
    expected = [0.75, 0.75, 264 / 300 / 2**0.5, 264 / 300 * 2**0.5]
    assert even_boxes()[-1].tolist() == pytest.approx(expected)


def test_clipped_boxes_end_at_the_border() -> None:
    boxes = to_centre(
        torch.tensor([[-0.1, 0.2, 0.3, 1.2], [0.4, 0.4, 0.5, 0.5], [-1.0, -1.0, 2.0, 2.0]])
    )
    expected = [[0.0, 0.2, 0.3, 1.0], [0.4, 0.4, 0.5, 0.5], [0.0, 0.0, 1.0, 1.0]]
    torch.testing.assert_close(to_corners(clipped(boxes)), torch.tensor(expected))
