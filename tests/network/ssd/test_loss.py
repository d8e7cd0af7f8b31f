import math

import pytest
import torch

from shaftpose.dataset.batches import Targets
from shaftpose.network.ssd.default_boxes import encode_boxes, to_centre
from shaftpose.network.ssd.heads import HeadOutputs
from shaftpose.network.ssd.loss import LossTerms, ShaftLoss, hard_negatives, match_boxes
from shaftpose.network.ssd.pose_bins import BinCoder
from shaftpose.network.ssd.pose_coding import PoseCoder, RegressionCoder
from tests.network.ssd.even_boxes import even_boxes

# Ten boxes in a row that do not overlap; the ground truth is exactly the third one.
DEFAULTS = torch.tensor([[0.05 + 0.1 * i, 0.5, 0.1, 0.2] for i in range(10)])
BOX = [0.2, 0.4, 0.3, 0.6]
POSE = [20.0, 0.0, 25.0, 70.0, 179.0]  # encoded: 1, 0, 0, 0, 0
PAPER_LOSS = ShaftLoss(alpha=1.5, beta=(1, 1, 2, 2, 2), gamma=5.0)


def targets(has_pose: bool = True, valid: bool = True, pose: list[float] = POSE) -> Targets:
    return Targets(
        boxes=torch.tensor([[BOX]]),
        poses=torch.tensor([[pose]]),
        valid=torch.tensor([[valid]]),
        has_pose=torch.tensor([has_pose]),
    )


def zero_outputs(batch: int = 1, pose_values: int = 5) -> HeadOutputs:
    outputs = HeadOutputs(*(torch.zeros(batch, 10, values) for values in (2, 4, pose_values)))
    for output in outputs:
        output.requires_grad_()
    return outputs


def paper_loss(outputs: HeadOutputs, truth: Targets, pose_coder: PoseCoder) -> LossTerms:
    return PAPER_LOSS(outputs, truth, DEFAULTS, pose_coder)


def test_value_by_hand(pose_coder: RegressionCoder) -> None:
    outputs = zero_outputs()
    outputs.box_offsets.data[0, 2] = torch.tensor([0.5, 2.0, 0.0, 0.0])
    outputs.poses.data[0, :, 3] = 0.1  # pitch off by 0.1 on all boxes, of which 1 counts
    terms = paper_loss(outputs, targets(), pose_coder)
    confidence = 4 * math.log(2)  # one positive, three negatives, undecided logits
    box = 0.5 * 0.5**2 + (2.0 - 0.5)
    pose = 1 * (5.0 * 1.0 - 0.5) + 2 * 0.5 * (5.0 * 0.1) ** 2  # x, then pitch
    assert terms.matched.item() == 1
    assert terms.confidence.item() == pytest.approx(confidence)
    assert terms.box.item() == pytest.approx(box, rel=1e-5)
    assert terms.pose.item() == pytest.approx(pose)
    assert terms.loss.item() == pytest.approx(confidence + 1.5 * box + pose)


def test_perfect_answer_costs_nothing(pose_coder: RegressionCoder) -> None:
    defaults = even_boxes()
    truth = Targets(
        torch.tensor([[[0.2, 0.3, 0.8, 0.6], [0.1, 0.6, 0.3, 0.9]]]),
        torch.tensor([[POSE, [1.0, 2.0, 30.0, 80.0, 10.0]]]),
        torch.ones(1, 2, dtype=torch.bool),
        torch.tensor([True]),
    )
    matched = match_boxes(truth.boxes, truth.valid, defaults)[0]
    found = (matched >= 0)[:, None]
    outputs = HeadOutputs(
        torch.where(found, torch.tensor([-30.0, 30.0]), torch.tensor([30.0, -30.0]))[None],
        encode_boxes(truth.boxes[0, matched], defaults)[None],
        torch.where(found, pose_coder.encode(truth.poses[0, matched]), 0.0)[None],
    )
    terms = PAPER_LOSS(outputs, truth, defaults, pose_coder)
    assert terms.matched.item() == int(found.sum()) > 2
    assert terms.loss.item() == pytest.approx(0.0, abs=1e-6)


def test_pose_classes_by_hand(bin_coder: BinCoder) -> None:
    """All logits are equal except those of pitch, whose fifth class, 70..75 deg, is correct."""
    outputs = zero_outputs(pose_values=190)
    outputs.poses.data[0, 2, 110 + 4] = math.log(7)  # its exp is the sum of those of the others
    terms = paper_loss(outputs, targets(), bin_coder)
    chances = [1 / 40, 1 / 40, 1 / 30, 1 / 2, 1 / 72]
    weighted = zip((1, 1, 2, 2, 2), chances, strict=True)
    assert terms.pose.item() == pytest.approx(sum(-beta * math.log(p) for beta, p in weighted))
    confidence = 4 * math.log(2)
    assert terms.loss.item() == pytest.approx(
        confidence + 1.5 * terms.box.item() + terms.pose.item()
    )


def with_and_without_pose() -> Targets:
    """Two images with a box each; the pose of the second one is unknown."""
    return Targets(
        torch.tensor([[BOX], [BOX]]),
        torch.tensor([[POSE], [[math.nan] * 5]]),
        torch.ones(2, 1, dtype=torch.bool),
        torch.tensor([True, False]),
    )


@pytest.mark.parametrize("coder", ["pose_coder", "bin_coder"])
def test_images_without_pose_do_not_move_the_pose(
    coder: str, request: pytest.FixtureRequest
) -> None:
    pose_coder: PoseCoder = request.getfixturevalue(coder)
    outputs = zero_outputs(batch=2, pose_values=pose_coder.values)
    terms = paper_loss(outputs, with_and_without_pose(), pose_coder)
    terms.loss.backward()
    pose_gradient, class_gradient = outputs.poses.grad, outputs.class_logits.grad
    assert pose_gradient is not None and class_gradient is not None
    assert pose_gradient.isfinite().all()
    assert pose_gradient[0].any() and not pose_gradient[1].any()
    assert class_gradient[1].any()
    alone = paper_loss(zero_outputs(pose_values=pose_coder.values), targets(), pose_coder)
    assert alone.pose > 1
    assert terms.pose.item() == pytest.approx(alone.pose.item() / 2)  # over two matched boxes


def test_no_instrument_no_loss(pose_coder: RegressionCoder) -> None:
    terms = paper_loss(zero_outputs(), targets(valid=False), pose_coder)
    assert [term.item() for term in terms] == [0, 0, 0, 0, 0]


def test_batch_without_any_ground_truth(pose_coder: RegressionCoder) -> None:
    empty = Targets(
        torch.zeros(1, 1, 4), torch.zeros(1, 1, 5),
        torch.tensor([[False]]), torch.tensor([True]),
    )  # fmt: skip
    terms = paper_loss(zero_outputs(), empty, pose_coder)
    terms.loss.backward()
    assert terms.loss.item() == 0


def test_half_precision_outputs_are_summed_in_float32(pose_coder: RegressionCoder) -> None:
    outputs = HeadOutputs(*(output.bfloat16() for output in zero_outputs()))
    with torch.autocast("cpu", dtype=torch.bfloat16):
        terms = paper_loss(outputs, targets(), pose_coder)
    assert terms.loss.dtype == torch.float32
    expected = paper_loss(zero_outputs(), targets(), pose_coder)
    assert terms.loss.item() == expected.loss.item()


# Four default boxes: the left half, the right half, the whole image, a small one in the corner.
FOUR_BOXES = to_centre(
    torch.tensor(
        [[0.0, 0.0, 0.5, 1.0], [0.5, 0.0, 1.0, 1.0], [0.0, 0.0, 1.0, 1.0], [0.9, 0.9, 1.0, 1.0]]
    )
)


def matched(boxes: list[list[float]], valid: list[bool]) -> list[int]:
    return match_boxes(torch.tensor([boxes]), torch.tensor([valid]), FOUR_BOXES)[0].tolist()


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
