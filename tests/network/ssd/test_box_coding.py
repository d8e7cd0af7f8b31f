import math

import pytest
import torch

from shaftpose.network.ssd.box_coding import decode_boxes, encode_boxes
from shaftpose.network.ssd.boxes import to_corners
from tests.network.ssd.even_boxes import even_boxes


def test_encode_by_hand() -> None:
    default = torch.tensor([[0.5, 0.5, 0.2, 0.4]])
    box = to_corners(torch.tensor([[0.51, 0.48, 0.4, 0.2]]))
    expected = [0.01 / 0.2 / 0.1, -0.02 / 0.4 / 0.1, math.log(2) / 0.2, -math.log(2) / 0.2]
    assert encode_boxes(box, default)[0].tolist() == pytest.approx(expected, abs=1e-5)


def test_decode_undoes_encode() -> None:
    defaults = even_boxes()
    boxes = torch.tensor([0.2, 0.3, 0.9, 0.7]).expand(2, len(defaults), 4)
    torch.testing.assert_close(decode_boxes(encode_boxes(boxes, defaults), defaults), boxes)
