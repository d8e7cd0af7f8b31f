import math

import pytest
import torch

from shaftpose.network.ssd.default_boxes import (
    BOXES_PER_CELL,
    clipped,
    decode_boxes,
    encode_boxes,
    pairwise_iou,
    to_centre,
    to_corners,
)
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


def test_encode_by_hand() -> None:
    default = torch.tensor([[0.5, 0.5, 0.2, 0.4]])
    box = to_corners(torch.tensor([[0.51, 0.48, 0.4, 0.2]]))
    expected = [0.01 / 0.2 / 0.1, -0.02 / 0.4 / 0.1, math.log(2) / 0.2, -math.log(2) / 0.2]
    assert encode_boxes(box, default)[0].tolist() == pytest.approx(expected, abs=1e-5)


def test_decode_undoes_encode() -> None:
    defaults = even_boxes()
    boxes = torch.tensor([0.2, 0.3, 0.9, 0.7]).expand(2, len(defaults), 4)
    torch.testing.assert_close(decode_boxes(encode_boxes(boxes, defaults), defaults), boxes)


def test_conversions_undo_each_other() -> None:
    boxes = even_boxes()
    assert to_corners(torch.tensor([0.5, 0.4, 0.2, 0.4])).tolist() == pytest.approx(
        [0.4, 0.2, 0.6, 0.6]
    )
    torch.testing.assert_close(to_centre(to_corners(boxes)), boxes)


def test_iou_by_hand() -> None:
    first = torch.tensor([[0.0, 0.0, 2.0, 2.0], [5.0, 5.0, 5.0, 5.0]])
    second = torch.tensor([[1.0, 1.0, 3.0, 3.0], [0.0, 0.0, 2.0, 1.0], [4.0, 4.0, 5.0, 5.0]])
    expected = torch.tensor([[1 / 7, 1 / 2, 0.0], [0.0, 0.0, 0.0]])
    torch.testing.assert_close(pairwise_iou(first, second), expected)


def test_iou_of_a_batch() -> None:
    boxes = torch.tensor([[[0.0, 0.0, 1.0, 1.0]], [[0.0, 0.0, 1.0, 2.0]]])
    iou = pairwise_iou(boxes, torch.tensor([[0.0, 0.0, 1.0, 1.0]]))
    assert iou.tolist() == [[[1.0]], [[0.5]]]
