from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor, nn
from torch.nn import functional

from shaftpose.core.instruments import Detections
from shaftpose.export.parity import check_parity

IMAGES = np.zeros((1, 299, 299, 3), dtype=np.uint8)
BOXES = [[10.0, 10.0, 60.0, 60.0], [100.0, 100.0, 180.0, 140.0]]
SCORES = [0.9, 0.7]
POSES = [[1.0, 2.0, 20.0, 70.0, 359.9], [0.0, 0.0, 30.0, 60.0, 90.0]]
ELSEWHERE = [200.0, 200.0, 250.0, 250.0]


class Known(nn.Module):
    """Stands in for the PyTorch detector: the same detections in any image, padded to `most`."""

    def __init__(self, boxes: Any = BOXES, scores: Any = SCORES, most: int = 4) -> None:
        super().__init__()
        self.boxes, self.scores, self.padding = boxes, scores, (0, 0, 0, most - len(boxes))

    def forward(self, images: Tensor) -> tuple[Tensor, ...]:
        poses = (POSES * 2)[: len(self.boxes)]
        boxes, scores, poses = (torch.tensor(v) for v in (self.boxes, self.scores, poses))
        return (
            functional.pad(boxes, self.padding)[None],
            functional.pad(scores, self.padding[2:])[None],
            functional.pad(poses, self.padding)[None],
        )


def file_that_finds(boxes: list[Any], scores: list[float], poses: list[Any] | None = None) -> Any:
    """Stands in for the exported file."""
    poses = (POSES * 2)[: len(boxes)] if poses is None else poses
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


def test_one_class_in_a_hundred_may_be_another() -> None:
    """At least one is allowed, here one of two. Poses that are numbers may never jump."""
    one, both = [POSES[0], [0.0, 0.0, 31.0, 60.0, 90.0]], [[5.0, 2.0, 20.0, 70.0, 359.9]] * 2
    for poses, jumped, holds in ((POSES, 0, True), (one, 1, True), (both, 2, False)):
        file = file_that_finds(BOXES, SCORES, poses)
        parity = check_parity(Known(), file, IMAGES, continuous=False)
        assert (parity.jumped, parity.jumps_allowed, parity.holds) == (jumped, 1, holds)
        numbers = check_parity(Known(), file, IMAGES)
        assert (numbers.jumped, numbers.jumps_allowed, numbers.holds) == (jumped, 0, jumped == 0)


def test_a_detection_that_is_not_found_is_missing() -> None:
    # The file's detection scores higher than the missing one, but its list had room.
    parity = check_parity(Known(), file_that_finds(BOXES[:1], SCORES[:1]), IMAGES)
    assert (parity.missing, parity.extra, parity.tied) == (1, 0, 0)
    assert not parity.holds


def test_nothing_found_is_all_missing() -> None:
    nothing = Detections(np.empty((0, 4)), np.empty(0), np.empty((0, 5)))
    assert check_parity(Known(), lambda images: [nothing], IMAGES).missing == 2


def test_a_detection_that_only_the_file_has_is_extra() -> None:
    boxes, scores = [*BOXES, ELSEWHERE], [*SCORES, 0.3]
    parity = check_parity(Known(), file_that_finds(boxes, scores), IMAGES)
    assert (parity.missing, parity.extra, parity.tied) == (0, 1, 0)
    assert not parity.holds


def test_a_detection_that_the_file_repeats_is_extra() -> None:
    boxes, scores = [BOXES[0], *BOXES], [0.9, *SCORES]
    poses = [POSES[0], *POSES]
    parity = check_parity(Known(), file_that_finds(boxes, scores, poses), IMAGES)
    assert (parity.missing, parity.extra) == (0, 1)


def test_what_scores_below_the_limit_does_not_count() -> None:
    boxes, scores = [*BOXES, ELSEWHERE], [*SCORES, 0.05]
    parity = check_parity(Known(), file_that_finds(boxes, scores), IMAGES)
    assert parity.holds
    assert check_parity(Known(), file_that_finds(boxes, scores), IMAGES, 0.0).extra == 1


def test_if_nothing_scores_as_the_limit_all_is_compared() -> None:
    poses = [[1.0, 2.0, 21.0, 70.0, 359.9], POSES[1]]
    parity = check_parity(Known(), file_that_finds(BOXES, SCORES, poses), IMAGES, 0.95)
    assert parity.detections == 2
    assert not parity.holds


@pytest.mark.parametrize(("apart", "holds"), [(0.008, True), (0.012, False)])
def test_poses_may_differ_by_a_hundredth(apart: float, holds: bool) -> None:
    poses = [[value + apart for value in POSES[0]], POSES[1]]
    assert check_parity(Known(), file_that_finds(BOXES, SCORES, poses), IMAGES).holds == holds


def test_a_pose_that_is_no_number_does_not_hold() -> None:
    poses = [[float("nan")] * 5, POSES[1]]
    assert not check_parity(Known(), file_that_finds(BOXES, SCORES, poses), IMAGES).holds


def test_a_neighbour_of_equal_score_is_a_tie() -> None:
    # The first box is replaced by one that overlaps it and has its score.
    boxes = [[12.0, 12.0, 64.0, 64.0], BOXES[1]]
    parity = check_parity(Known(), file_that_finds(boxes, SCORES), IMAGES)
    assert (parity.tied, parity.missing, parity.extra) == (2, 0, 0)
    assert parity.holds


def test_what_a_tie_uncovers_is_tied_too() -> None:
    # PyTorch's first box suppressed the file's last one; the file's own first box does not.
    boxes = [[12.0, 12.0, 64.0, 64.0], BOXES[1], [10.0, 40.0, 60.0, 90.0]]
    parity = check_parity(Known(), file_that_finds(boxes, [0.9, 0.7, 0.5]), IMAGES)
    assert (parity.tied, parity.missing, parity.extra) == (3, 0, 0)


def test_a_neighbour_that_both_have_excuses_nothing() -> None:
    # The box that the file lacks overlaps one of equal score, but both sides have that one.
    known = Known([*BOXES, [10.0, 50.0, 60.0, 110.0]], [0.9, 0.7, 0.9])
    parity = check_parity(known, file_that_finds(BOXES, SCORES), IMAGES)
    assert (parity.tied, parity.missing) == (0, 1)


def test_the_last_of_a_full_list_may_lose_to_an_equal_score() -> None:
    file = file_that_finds([BOXES[0], ELSEWHERE], SCORES)
    parity = check_parity(Known(most=2), file, IMAGES)
    assert (parity.tied, parity.missing, parity.extra) == (2, 0, 0)
    roomy = check_parity(Known(most=3), file, IMAGES)
    assert (roomy.tied, roomy.missing, roomy.extra) == (0, 1, 1)


def test_a_full_list_does_not_excuse_a_better_score() -> None:
    file = file_that_finds([BOXES[0], ELSEWHERE], [0.9, 0.8])
    parity = check_parity(Known(most=2), file, IMAGES)
    assert parity.extra == 1
    assert not parity.holds
