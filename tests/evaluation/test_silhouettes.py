"""The comparison of silhouettes, with made-up predictors and a renderer of rectangles."""

from collections.abc import Sequence
from pathlib import Path
from typing import cast

import numpy as np
import pytest
from numpy.typing import NDArray

from shaftpose.core.geometry import Camera
from shaftpose.core.instruments import Annotations, Detections
from shaftpose.evaluation import silhouettes
from shaftpose.evaluation.masked_images import MaskedImage
from shaftpose.evaluation.silhouettes import compare_silhouettes
from shaftpose.image_files.reading import read_rgb
from shaftpose.inference.predictor import Predictor

SIDE = 100
# 1 mm is 10 px at a depth of 10 mm.
CAMERA = Camera(width=SIDE, height=SIDE, focal_px=100.0, cx=50.0, cy=50.0)
BOX = np.array([[20.0, 40.0, 60.0, 60.0]])
MASK = np.zeros((SIDE, SIDE), dtype=bool)
MASK[40:60, 20:60] = True
AXIS = np.array([[[20.0, 50.0], [60.0, 50.0]]])  # px; the tip, 3 mm left of the middle


def image(grey: int, shown: bool = True) -> MaskedImage:
    rgb = np.full((SIDE, SIDE, 3), grey, dtype=np.uint8)
    boxes = BOX if shown else np.empty((0, 4))
    axes = AXIS if shown else np.empty((0, 2, 2))
    return MaskedImage(rgb, Annotations(boxes, None), [MASK] if shown else [], axes, CAMERA)


class Shifted:
    """Finds the shaft of each image, shifted to the right by its grey value in mm; none in white
    images."""

    refiner = None

    def __call__(self, images: NDArray[np.uint8]) -> list[Detections]:
        return [self._found(int(rgb[0, 0, 0])) for rgb in images]

    def _found(self, grey: int) -> Detections:
        poses = np.array([[-3.0 + grey, 0, 10, 90, 0]])
        found = Detections(BOX, np.array([0.9]), poses)
        return found.above(1) if grey == 255 else found


def render(poses: NDArray[np.float64], camera: Camera) -> Sequence[NDArray[np.bool_]]:
    """The mask, shifted to the pose's tip."""
    return [np.roll(MASK, 10 * round(pose[0] + 3), axis=1) for pose in poses]


def test_scores_of_a_set_by_hand(tmp_path: Path) -> None:
    # Shifted by 0, 1 and 2 mm, 20 px of 40, and missed: IoU 1, 30/50, 20/60, 0.
    sets = {"real/clear": [image(0), image(1), image(2), image(255)]}
    predictors = [cast(Predictor, Shifted())] * 2
    scores, _ = compare_silhouettes(predictors, [0.5, 0.95], render, sets, tmp_path)
    score = scores.raw["real/clear"]
    assert (score.detected_rate, score.images, score.instruments) == (0.75, 4, 4)
    assert score.iou == pytest.approx((1 + 3 / 5 + 1 / 3) / 4)
    assert score.tip_px == pytest.approx(10)  # the median of 0, 10 and 20
    assert (score.image_axis_deg, score.axis_px) == (pytest.approx(0), pytest.approx(0))
    assert scores.refined is not None
    unsure = scores.refined["real/clear"]  # at its own threshold
    assert (unsure.detected_rate, unsure.iou, unsure.tip_px) == (0, 0, None)


def test_a_missing_confidence_is_noticed(tmp_path: Path) -> None:
    predictors = [cast(Predictor, Shifted())] * 2
    with pytest.raises(ValueError, match="shorter"):
        compare_silhouettes(predictors, [0.5], render, {"real/clear": [image(0)]}, tmp_path)


def test_the_worst_images_of_each_set_come_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(silhouettes, "WORST", 2)
    monkeypatch.setattr(silhouettes, "WORST_COLUMNS", 2)
    monkeypatch.setattr(silhouettes, "DRAWN_IMAGES", 2)
    captions: list[str] = []

    def drawn(picture: NDArray[np.uint8], text: str) -> NDArray[np.uint8]:
        captions.append(text)
        return picture

    monkeypatch.setattr(silhouettes, "draw_caption", drawn)
    sets = {
        "rendered/clear": [image(0)],
        "real/clear": [image(0), image(2), image(1), image(255), image(255, shown=False)],
    }
    _, pictures = compare_silhouettes([cast(Predictor, Shifted())], [0.5], render, sets, tmp_path)
    assert captions == [
        "rendered/clear", "rendered/clear IoU 1.00", "real/clear", "real/clear",
        "real/clear IoU 0.00", "real/clear IoU 0.33",
    ]  # fmt: skip
    assert read_rgb(pictures["worst_silhouettes"]).shape == (2 * SIDE, 2 * SIDE, 3)
    assert read_rgb(pictures["silhouettes"]).shape == (2 * SIDE, 2 * SIDE, 3)
