"""Which test images the gallery of the worst predictions shows."""

import numpy as np

from shaftpose.core.instruments import Annotations
from shaftpose.evaluation.model_results import worst_images
from shaftpose.metrics.detection.precision_recall import PrecisionRecall
from shaftpose.metrics.pose_errors import PoseErrors
from shaftpose.metrics.table import ComparedImages


def with_instruments(count: int) -> Annotations:
    return Annotations(np.zeros((count, 4)), np.zeros((count, 5)))


def with_errors(tip_mm: dict[int, float], known: list[Annotations]) -> ComparedImages:
    """Images with errors of the instruments with these numbers; the others were missed."""
    values, count = np.array(list(tip_mm.values())), len(tip_mm)
    numbers = np.array(list(tip_mm), dtype=np.intp)
    poses = np.zeros((count, 5))
    errors = PoseErrors(poses, np.zeros(count), values, poses, numbers)
    return ComparedImages([], known, 0.5, PrecisionRecall(*np.empty((3, 0))), errors)


def test_large_errors_come_first_and_missed_shafts_after() -> None:
    # Instruments 0 and 1 are in image 0, none in image 1, 2 and 3 in image 2, 4 in 3, 5 in 4.
    known = [with_instruments(count) for count in (2, 0, 2, 1, 1)]
    images = with_errors({0: 0.1, 2: 3.0, 3: 2.0, 5: 0.5}, known)  # 1 and 4 were missed
    assert worst_images(images, 10) == [2, 4, 0, 3]
    assert worst_images(images, 1) == [2, 0]


def test_nothing_is_shown_where_nothing_is_wrong() -> None:
    assert worst_images(with_errors({}, [with_instruments(0)]), 10) == []
