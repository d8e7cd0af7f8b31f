import pytest
import torch

from shaftpose.network.ssd.boxes import pairwise_iou, to_centre, to_corners
from tests.network.ssd.even_boxes import even_boxes


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
