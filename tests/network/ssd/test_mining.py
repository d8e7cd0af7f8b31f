import pytest
import torch

from shaftpose.network.ssd.mining import hard_negatives


@pytest.mark.parametrize(("positives", "negatives"), [(0, 0), (1, 3), (2, 6), (3, 7)])
def test_three_negatives_per_positive(positives: int, negatives: int) -> None:
    positive = (torch.arange(10) < positives)[None]
    chosen = hard_negatives(torch.zeros(1, 10, 2), positive, ratio=3)
    assert int(chosen.sum()) == negatives
    assert not (chosen & positive).any()


def test_hardest_negatives_are_chosen_image_by_image() -> None:
    instrument = torch.tensor([[9.0, 1, 7, 2, 3, 4], [0.0, 5, 4, 3, 2, 1]])
    logits = torch.stack([torch.zeros(2, 6), instrument], dim=-1)
    positive = torch.zeros(2, 6, dtype=torch.bool)
    positive[0, 0] = positive[1, 1] = True
    chosen = hard_negatives(logits, positive, ratio=2)
    assert chosen.nonzero().tolist() == [[0, 2], [0, 5], [1, 2], [1, 3]]
