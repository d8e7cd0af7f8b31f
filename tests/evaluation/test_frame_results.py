"""Results and pictures of a made-up model on frames of a hundred rows."""

from pathlib import Path
from typing import cast

import numpy as np
import pytest

from shaftpose.core.images import write_jpeg
from shaftpose.dataset.coco_images import CocoImage
from shaftpose.evaluation import frame_gallery
from shaftpose.evaluation.frame_gallery import errors_of, gallery
from shaftpose.evaluation.frame_results import compared_frames, metrics_by_group
from shaftpose.evaluation.whole_frames import FrameModel
from shaftpose.metrics.frames.comparison import FoundShafts
from tests.evaluation.test_true_shafts import HEIGHT, WIDTH, rows, shaft

UPPER, LOWER = rows(10, 20), rows(50, 60)


class Upper:
    """Finds the upper shaft in every frame, and is not sure of the lower one."""

    threshold = 0.5

    def __call__(self, image: CocoImage) -> FoundShafts:
        boxes = np.array([[0, 10, WIDTH, 20], [0, 50, WIDTH, 60]], dtype=np.float64)
        middles = [[[0.0, y], [10.0, y]] for y in (15.0, 55.0)]
        return FoundShafts(np.array([0.9, 0.4]), boxes, [UPPER, LOWER], np.array(middles))


MODEL = cast(FrameModel, Upper())


def images(folder: Path) -> list[CocoImage]:
    """A frame with the upper shaft, one with both, and one without any."""
    shafts = [(shaft(UPPER),), (shaft(UPPER), shaft(LOWER, occluded=True)), ()]
    rgb = np.full((HEIGHT, WIDTH, 3), 60, dtype=np.uint8)
    for name in "abc":
        write_jpeg(rgb, folder / f"{name}.jpg")
    return [
        CocoImage(folder / f"{name}.jpg", WIDTH, HEIGHT, shown, operation=name)
        for name, shown in zip("abc", shafts, strict=True)
    ]


def test_results_are_stated_for_all_shafts_and_the_groups_that_are_there(tmp_path: Path) -> None:
    shown = images(tmp_path)
    groups = metrics_by_group(compared_frames(MODEL, shown), shown)
    assert list(groups) == ["all", "clear", "occluded"]
    counts = groups["all"].counts
    assert (counts.frames, counts.operations, counts.shafts) == (3, 3, 3)
    assert (counts.found, counts.missed, counts.false) == (2, 1, 1)
    recalls = {name: group.metrics["axis_recall"].value for name, group in groups.items()}
    assert recalls == {"all": pytest.approx(2 / 3), "clear": 1, "occluded": 0}
    assert groups["all"].metrics["empty_detected"].value == 1


def test_the_gallery_shows_the_worst_frames_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    captions: list[str] = []

    def caption(picture: np.ndarray, text: str) -> np.ndarray:
        captions.append(text)
        return picture

    monkeypatch.setattr(frame_gallery, "draw_caption", caption)
    shown = images(tmp_path)
    frames = compared_frames(MODEL, shown)
    assert [errors_of(frame) for frame in frames] == [(0, 0), (1, 0), (0, 1)]
    sheet = gallery(MODEL, shown, frames, "model")
    assert captions == ["model: 1 missed, 0 false", "model: 0 missed, 1 false"]
    assert sheet is not None
    assert sheet.shape == (frame_gallery.HEIGHT, 4 * frame_gallery.WIDTH, 3)
    # Enlarged by 1.8: the outline of the missed shaft is green at row 90, the upper one's yellow.
    missed = sheet[:, : frame_gallery.WIDTH]
    assert missed[88:93, 100].astype(int).max(axis=0)[1] > 120
    assert missed[88:93, 100, 0].max() < 80
    assert missed[16:21, 100, 0].max() > 150
    assert gallery(MODEL, shown[:1], frames[:1], "model") is None
