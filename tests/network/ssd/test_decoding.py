from dataclasses import replace

import pytest
import torch

from shaftpose.network.ssd.decoding import decode, nms_mask
from shaftpose.network.ssd.default_boxes import encode_boxes, pairwise_iou, to_centre
from shaftpose.network.ssd.heads import HeadOutputs
from shaftpose.network.ssd.pose_coding import RegressionCoder
from tests.network.tiny import LIMITS


def test_nms_by_hand() -> None:
    # In a row, each box overlaps the next by 2/3: the second is suppressed by the first, so the
    # third, which only the second overlaps enough, survives.
    boxes = torch.tensor([[[0.0, 0, 10, 1], [2, 0, 12, 1], [4, 0, 14, 1], [50, 0, 60, 1]]])
    scores = torch.tensor([[0.9, 0.8, 0.7, 0.1]])
    assert nms_mask(boxes, scores, 0.5).tolist() == [[1, 0, 1, 1]]
    assert nms_mask(boxes, scores, 0.4).tolist() == [[1, 0, 0, 1]]


def test_nms_does_not_need_sorted_scores() -> None:
    boxes = torch.tensor([[[4.0, 0, 14, 1], [0, 0, 10, 1], [2, 0, 12, 1]]])
    scores = torch.tensor([[0.7, 0.8, 0.9]])
    assert nms_mask(boxes, scores, 0.5).tolist() == [[0, 0, 1]]


def greedy(boxes: torch.Tensor, scores: torch.Tensor, threshold: float) -> list[int]:
    """The textbook loop."""
    overlap, kept = pairwise_iou(boxes, boxes), list[int]()
    for i in scores.argsort(descending=True).tolist():
        if all(overlap[i, j] <= threshold for j in kept):
            kept.append(i)
    return sorted(kept)


def test_nms_is_exactly_the_greedy_rule() -> None:
    generator = torch.Generator().manual_seed(0)
    corners = torch.rand(3, 120, 2, generator=generator)
    sizes = 0.1 + 0.3 * torch.rand(3, 120, 2, generator=generator)
    boxes = torch.cat([corners, corners + sizes], dim=-1)
    scores = torch.rand(3, 120, generator=generator)
    mask = nms_mask(boxes, scores, 0.3)
    for i in range(3):
        kept = mask[i].nonzero().flatten().tolist()
        assert kept == greedy(boxes[i], scores[i], 0.3)
        assert 10 < len(kept) < 110


def test_nms_operator_is_well_formed() -> None:
    torch.library.opcheck(nms_mask, (torch.rand(2, 5, 4), torch.rand(2, 5), 0.5))


DEFAULTS = to_centre(
    torch.tensor([[0.0, 0.0, 0.5, 0.5], [0.5, 0.5, 1.0, 1.0], [0.5, 0.0, 1.0, 0.5]])
)


def outputs_for(logits: list[float]) -> HeadOutputs:
    """Box 0 is at its default; 1 extends beyond the image; 2 is moved onto 0. Poses differ."""
    boxes = torch.tensor([[0.0, 0.0, 0.5, 0.5], [0.5, 0.5, 1.2, 1.1], [0.0, 0.0, 0.5, 0.49]])
    class_logits = torch.stack([torch.zeros(3), torch.tensor(logits)], dim=-1)
    poses = torch.tensor([[0.0] * 5, [0.5] * 5, [-0.5] * 5])
    return HeadOutputs(class_logits[None], encode_boxes(boxes, DEFAULTS)[None], poses[None])


def test_decode_by_hand(pose_coder: RegressionCoder) -> None:
    found = decode(
        outputs_for([1.0, 3.0, 2.0]),
        DEFAULTS,
        pose_coder,
        replace(LIMITS, top_k=3, max_detections=3),
    )
    sigmoid = torch.tensor([3.0, 2.0]).sigmoid().tolist()
    assert found.scores[0].tolist() == pytest.approx([*sigmoid, 0.0])
    expected = torch.tensor([[149.5, 149.5, 299, 299], [0, 0, 149.5, 146.51], [0, 0, 0, 0]])
    torch.testing.assert_close(found.boxes[0], expected, atol=1e-3, rtol=0)
    poses = torch.tensor([[10, 10, 32.5, 80, 268.5], [-10, -10, 17.5, 60, 89.5], [0] * 5])
    torch.testing.assert_close(found.poses[0], poses)


def test_top_k_and_keep_limit_the_detections(pose_coder: RegressionCoder) -> None:
    # By score: box 0, then 2, which 0 suppresses, then 1.
    outputs = outputs_for([3.0, 1.0, 2.0])
    first, second = torch.tensor([3.0, 1.0]).sigmoid().tolist()

    def scores(top_k: int, keep: int) -> list[float]:
        limits = replace(LIMITS, top_k=top_k, max_detections=keep)
        return decode(outputs, DEFAULTS, pose_coder, limits).scores[0].tolist()

    assert scores(top_k=3, keep=2) == pytest.approx([first, second])
    assert scores(top_k=2, keep=2) == pytest.approx([first, 0.0])  # 1 is not a candidate
    assert scores(top_k=3, keep=1) == pytest.approx([first])


def test_no_detection_is_all_zeros(pose_coder: RegressionCoder) -> None:
    found = decode(
        outputs_for([-200.0] * 3), DEFAULTS, pose_coder, replace(LIMITS, top_k=3, max_detections=2)
    )
    assert not any(values.any() for values in found)
