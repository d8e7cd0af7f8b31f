import torch

from shaftpose.network.ssd.boxes import to_centre
from shaftpose.network.ssd.matching import match_boxes
from tests.network.ssd.even_boxes import even_boxes

# Four default boxes: the left half, the right half, the whole image, a small one in the corner.
DEFAULTS = to_centre(
    torch.tensor(
        [[0.0, 0.0, 0.5, 1.0], [0.5, 0.0, 1.0, 1.0], [0.0, 0.0, 1.0, 1.0], [0.9, 0.9, 1.0, 1.0]]
    )
)


def matched(boxes: list[list[float]], valid: list[bool]) -> list[int]:
    return match_boxes(torch.tensor([boxes]), torch.tensor([valid]), DEFAULTS)[0].tolist()


def test_overlap_from_the_threshold_on() -> None:
    # IoU with the left half: 0.4 / 0.5 = 0.8; with the whole image: 0.4.
    assert matched([[0.0, 0.0, 0.4, 1.0]], [True]) == [0, -1, -1, -1]
    # With the left half: 1, then 0.98; with the whole image: exactly 0.5, then less.
    assert matched([[0.0, 0.0, 0.5, 1.0]], [True]) == [0, -1, 0, -1]
    assert matched([[0.0, 0.0, 0.49, 1.0]], [True]) == [0, -1, -1, -1]
    # With the left half 0.5 / 0.8 = 0.625; with the whole image 0.8.
    assert matched([[0.0, 0.0, 0.8, 1.0]], [True]) == [0, -1, 0, -1]


def test_every_ground_truth_gets_its_best_box() -> None:
    # IoU with the right half: 0.04 / 0.5; with the whole image: 0.04. Both below the threshold.
    assert matched([[0.6, 0.0, 0.8, 0.2]], [True]) == [-1, 0, -1, -1]


def test_force_match_wins_over_a_larger_overlap() -> None:
    whole, quarter = [0.0, 0.0, 1.0, 1.0], [0.0, 0.0, 0.5, 0.5]
    assert matched([whole, quarter], [True, True]) == [1, 0, 0, -1]


def test_later_ground_truth_wins_a_shared_best_box() -> None:
    first, second = [0.0, 0.0, 0.5, 0.9], [0.0, 0.0, 0.5, 0.8]
    assert matched([first, second], [True, True])[0] == 1
    assert matched([second, first], [True, True])[0] == 1


def test_padding_is_never_matched() -> None:
    left, padding = [0.0, 0.0, 0.5, 1.0], [0.0, 0.0, 1.0, 1.0]
    assert matched([left, padding], [True, False]) == [0, -1, 0, -1]
    assert matched([padding, left], [False, True]) == [1, -1, 1, -1]
    assert matched([left, left], [False, False]) == [-1, -1, -1, -1]


def test_images_of_a_batch_do_not_mix() -> None:
    boxes = torch.tensor([[[0.1, 0.1, 0.4, 0.4]], [[0.5, 0.2, 0.95, 0.8]]])
    valid = torch.ones(2, 1, dtype=torch.bool)
    together = match_boxes(boxes, valid, even_boxes())
    for i in range(2):
        alone = match_boxes(boxes[i : i + 1], valid[i : i + 1], even_boxes())
        assert torch.equal(together[i], alone[0])
        assert (alone >= 0).any()
