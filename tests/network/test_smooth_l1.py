import torch

from shaftpose.network.smooth_l1 import smooth_l1


def test_values_by_hand() -> None:
    errors = torch.tensor([[0.0, 0.5, -0.5], [1.0, -1.0, -3.0]])
    expected = torch.tensor([[0.0, 0.125, 0.125], [0.5, 0.5, 2.5]])
    torch.testing.assert_close(smooth_l1(errors), expected)
