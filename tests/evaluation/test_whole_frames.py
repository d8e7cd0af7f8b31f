"""What a model finds in whole frames, with a model whose answer is known."""

from pathlib import Path
from typing import cast

import numpy as np
import pytest

from shaftpose.core.cylinder import cylinder_depth
from shaftpose.core.errors import InputError
from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.core.images import write_jpeg
from shaftpose.dataset.coco_images import CocoImage
from shaftpose.evaluation.whole_frames import (
    FrameModel,
    convex_mask,
    field_mask,
    outline_px,
    tool_mask,
)
from shaftpose.export.onnx_export import store_metadata
from shaftpose.inference.frame_views import views
from shaftpose.inference.model_files import ModelMetadata, checksum
from shaftpose.inference.predictor import Predictor
from shaftpose.inference.views import View
from shaftpose.refinement.contour import Shaft
from tests.conftest import BOXES, POSES, SIDE

MODEL = Camera.from_field_of_view(SIDE, SIDE, 95.0)
SHAFT = Shaft(3.0)
METADATA = ModelMetadata(0.5, 95.0, 3.0, 150.0, "flat")


def view_of(width: int, height: int, frame_px: int | None) -> View:
    """The view of an unknown camera's frames."""
    return views(None, MODEL, frame_px, None, lambda _: None)(width, height, 1.0)


@pytest.mark.parametrize(
    "pose",
    [
        ShaftPose(1.0, -2.0, 20.0, 70.0, 123.0),
        ShaftPose(0.0, 0.0, 15.0, 85.0, 45.0),  # leaves by the corner
        ShaftPose(-8.0, 3.0, 25.0, 50.0, 200.0),  # grows towards the camera
    ],
)
def test_an_outline_encloses_what_the_camera_sees(pose: ShaftPose) -> None:
    view = view_of(2 * SIDE, 2 * SIDE, SIDE)
    found = convex_mask(outline_px(pose, SHAFT, view), (2 * SIDE, 2 * SIDE))
    seen = np.isfinite(cylinder_depth(view.camera.enlarged(2), pose, 3.0, 150.0))
    assert (found & seen).sum() / (found | seen).sum() > 0.97


def test_a_mask_holds_the_pixels_whose_centres_are_inside() -> None:
    mask = convex_mask(np.array([[10, 5], [20, 5], [20, 45], [10, 45]], float), (60, 80))
    rows, columns = np.argwhere(mask).T
    assert mask.sum() == 10 * 40
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (5, 44, 10, 19)
    triangle = convex_mask(np.array([[0, 0], [60.3, 0], [0, 60.3]], float), (60, 80))
    y, x = np.indices((60, 80)) + 0.5
    np.testing.assert_array_equal(triangle, x + y < 60.3)


def test_an_outline_lies_where_the_view_shows_it() -> None:
    pose = ShaftPose(0.0, 0.0, 15.0, 85.0, 45.0)
    square = outline_px(pose, SHAFT, view_of(SIDE, SIDE, None))
    in_wide = outline_px(pose, SHAFT, view_of(SIDE + 100, SIDE, None))
    np.testing.assert_allclose(in_wide, square + [50, 0])


def test_a_shaft_out_of_sight_has_no_mask() -> None:
    behind = ShaftPose(0.0, 0.0, -5.0, 70.0, 0.0)
    outline = outline_px(behind, SHAFT, view_of(SIDE, SIDE, None))
    assert not convex_mask(outline, (SIDE, SIDE)).any()


def test_the_field_is_the_stated_one_or_the_bright_one() -> None:
    rgb = np.zeros((100, 200, 3), dtype=np.uint8)
    assert field_mask(rgb, None).all()
    rgb[:, 50:150] = 120
    columns = np.flatnonzero(field_mask(rgb, None).all(axis=0))
    assert (columns[0], columns[-1]) == (50, 149)
    stated = field_mask(rgb, ((0.0, 0.0), (20.0, 0.0), (20.0, 100.0), (0.0, 100.0)))
    assert stated[:, :20].all()
    assert not stated[:, 20:].any()


def test_the_field_may_be_round() -> None:
    y, x = np.indices((200, 200)) + 0.5
    rgb = np.where(np.hypot(x - 100, y - 100)[..., None] < 80, 120, 0).astype(np.uint8)
    rgb = np.repeat(rgb, 3, axis=2)
    assert field_mask(rgb, None).sum() == pytest.approx(np.pi * 80**2, rel=0.03)


def test_a_model_finds_shafts_in_a_frames_pixels(constant_model: Path, tmp_path: Path) -> None:
    store_metadata(constant_model, METADATA)
    path = tmp_path / "frame.jpg"
    write_jpeg(np.full((2 * SIDE, 2 * SIDE, 3), 120, dtype=np.uint8), path)
    model = FrameModel(str(constant_model))
    found = model(CocoImage(path, 2 * SIDE, 2 * SIDE, ()))
    assert (model.threshold, model.sha256) == (0.5, checksum(constant_model).decode()[:64])
    assert found.scores.tolist() == [0.75, 0.25]  # the unsure one, too
    np.testing.assert_allclose(found.boxes, 2 * np.array(BOXES[:2]))
    tips = 2 * MODEL.project(np.array(POSES)[:2, :3])
    np.testing.assert_allclose(found.axes[:, 0], tips, atol=1e-3)
    seen = [
        np.isfinite(cylinder_depth(MODEL.enlarged(2), ShaftPose(*pose), 3.0, 150.0))
        for pose in POSES[:2]
    ]
    for mask, exact in zip(found.masks, seen, strict=True):
        assert (mask & exact).sum() / (mask | exact).sum() > 0.97
    assert found.tools is None


def test_masks_end_at_the_field(constant_model: Path, tmp_path: Path) -> None:
    store_metadata(constant_model, METADATA)
    path = tmp_path / "frame.jpg"
    write_jpeg(np.full((SIDE, SIDE, 3), 120, dtype=np.uint8), path)
    left = ((0.0, 0.0), (100.0, 0.0), (100.0, 299.0), (0.0, 299.0))
    (mask, _) = FrameModel(str(constant_model))(CocoImage(path, SIDE, SIDE, (), field=left)).masks
    assert mask[:, :100].any()
    assert not mask[:, 102:].any()


class Bright:
    """Takes bright pixels for instruments, and remembers the pictures that it saw."""

    def __init__(self, says: bool = True) -> None:
        self.says, self.sizes = says, list[tuple[int, ...]]()

    def tools(self, images: np.ndarray) -> np.ndarray | None:
        self.sizes.append(images.shape)
        return images[..., 0] / np.float32(255) if self.says else None


def test_tools_are_found_in_a_frames_pixels() -> None:
    # A grey picture in columns 200 to 1000, with a white instrument in its lower left.
    rgb = np.zeros((2 * SIDE, 1200, 3), dtype=np.uint8)
    rgb[:, 200:1000] = 60
    rgb[400:, 200:400] = 255
    bright, view = Bright(), view_of(1200, 2 * SIDE, SIDE)
    found = tool_mask(cast(Predictor, bright), rgb, view)
    assert found is not None
    assert found.shape == rgb.shape[:2]
    assert np.count_nonzero(found != (rgb[..., 0] == 255)) < 2 * (200 + 200)  # of its border
    assert bright.sizes == [(1, SIDE, 400, 3)]  # the picture alone
    assert tool_mask(cast(Predictor, Bright(says=False)), rgb, view) is None


def test_a_model_without_a_shaft_is_refused(constant_model: Path) -> None:
    store_metadata(constant_model, ModelMetadata(0.5))
    with pytest.raises(InputError, match=r"constant\.onnx: knows an instrument from a CAD file"):
        FrameModel(str(constant_model))
