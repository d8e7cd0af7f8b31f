from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from shaftpose.deployment.parity import check_parity
from shaftpose.instruments import Detections

IMAGES = np.zeros((1, 299, 299, 3), dtype=np.uint8)
BOXES = [[10.0, 10.0, 60.0, 60.0], [100.0, 100.0, 180.0, 140.0]]
SCORES = [0.9, 0.7]
POSES = [[1.0, 2.0, 20.0, 70.0, 359.9], [0.0, 0.0, 30.0, 60.0, 90.0]]


class Known(nn.Module):
    """Stands for the PyTorch detector: always the same two detections."""

    def forward(self, images: Tensor) -> tuple[Tensor, ...]:
        return tuple(torch.tensor([values]) for values in (BOXES, SCORES, POSES))


def file_that_finds(boxes: list[Any], scores: list[float], poses: list[Any]) -> Any:
    """Stands for the exported file."""
    return lambda images: [Detections(np.array(boxes), np.array(scores), np.array(poses))]


def test_equal_detections_agree() -> None:
    parity = check_parity(Known(), file_that_finds(BOXES, SCORES, POSES), IMAGES)
    assert (parity.detections, parity.missing, parity.tied) == (2, 0, 0)
    assert parity.pose < 1e-5
    assert parity.holds


def test_yaw_is_compared_around_the_circle() -> None:
    poses = [[1.0, 2.0, 20.0, 70.0, 0.1], POSES[1]]
    parity = check_parity(Known(), file_that_finds(BOXES, SCORES, poses), IMAGES)
    assert abs(parity.pose - 0.2) < 1e-4


def test_a_wrong_pose_and_a_wrong_score_do_not_hold() -> None:
    poses = [[1.0, 2.0, 21.0, 70.0, 359.9], POSES[1]]
    assert not check_parity(Known(), file_that_finds(BOXES, SCORES, poses), IMAGES).holds
    assert not check_parity(Known(), file_that_finds(BOXES, [0.9, 0.6], POSES), IMAGES).holds


def test_a_detection_that_is_not_found_is_missing() -> None:
    # What the file did find is better than what it lacks: no tie, no full list, a fault.
    parity = check_parity(
        Known(), file_that_finds([BOXES[1], [0, 0, 5, 5]], [0.7, 0.2], [POSES[1]] * 2), IMAGES
    )
    assert parity.missing == 1
    assert not parity.holds


def test_a_neighbour_of_equal_score_is_a_tie() -> None:
    # The first box is replaced by one that overlaps it and has its score.
    boxes = [[12.0, 12.0, 64.0, 64.0], BOXES[1]]
    parity = check_parity(Known(), file_that_finds(boxes, SCORES, POSES), IMAGES)
    assert (parity.tied, parity.missing) == (1, 0)
    assert parity.holds
