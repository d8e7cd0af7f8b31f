"""Random views: pixels, maps, boxes, tips, poses and cameras change together."""

import numpy as np
import pytest

from shaftpose.core.cylinder import cylinder_depth
from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.core.images import Image
from shaftpose.core.instruments import OUTSIDE, TOOL, Annotations
from shaftpose.core.masks import mask_box
from shaftpose.dataset.random_views import random_view

CAMERA = Camera.from_field_of_view(200, 200, 95.0)
POSE = ShaftPose(4.0, -3.0, 20.0, 70.0, 130.0)


def rendered() -> tuple[Image, Annotations]:
    """A white shaft on grey, with its pose."""
    mask = np.isfinite(cylinder_depth(CAMERA, POSE, 3.0, 150.0))
    rgb = np.where(mask[..., None], 255, 90).astype(np.uint8).repeat(3, axis=2)
    boxes = np.array([mask_box(mask)], float)
    return rgb, Annotations(boxes, POSE.as_array()[None], mask.astype(np.uint8), camera=CAMERA)


def frame() -> tuple[Image, Annotations]:
    """A white bar on grey in a frame of 240 x 160 px, with jaws and a tip, without a pose."""
    instances = np.zeros((160, 240), np.uint8)
    instances[70:80, 100:], instances[70:80, 90:100] = 1, TOOL
    rgb = np.where(instances[..., None] == 1, 255, 90).astype(np.uint8).repeat(3, axis=2)
    return rgb, Annotations(
        np.array([[100.0, 70, 240, 80]]), None, instances, np.array([[100.0, 75.0]])
    )


@pytest.mark.parametrize("seed", range(12))
def test_the_changed_pose_gives_the_changed_mask_in_the_changed_camera(seed: int) -> None:
    image, known = random_view(*rendered(), 150, np.random.default_rng(seed))
    assert known.poses is not None and known.camera is not None and known.instances is not None
    inside = known.instances != OUTSIDE
    size = image.shape[0]
    assert known.camera.width == size and known.instances.shape == (size, size)
    mask = np.isfinite(
        cylinder_depth(known.camera, ShaftPose.from_array(known.poses[0]), 3.0, 150.0)
    )
    different = (mask != (known.instances == 1)) & inside
    outline = np.count_nonzero(mask[1:] != mask[:-1]) + np.count_nonzero(
        mask[:, 1:] != mask[:, :-1]
    )
    assert different.sum() <= 0.7 * outline + 12  # nearest neighbours
    assert not image[~inside].any()
    shown = known.instances == 1
    expected = mask_box(shown) if shown.any() else (0, 0, 0, 0)
    assert known.boxes[0].tolist() == list(expected)


@pytest.mark.parametrize("seed", range(12))
def test_frames_without_poses_become_squares_and_tips_move_along(seed: int) -> None:
    image, known = random_view(*frame(), 150, np.random.default_rng(seed))
    assert image.shape == (150, 150, 3) and known.instances is not None
    assert known.tips_px is not None
    x, y = known.tips_px[0]
    if 4 < x < 146 and 4 < y < 146:
        around = known.instances[int(y) - 3 : int(y) + 4, int(x) - 3 : int(x) + 4]
        assert OUTSIDE in around or {1, TOOL} <= set(around.ravel().tolist())


def test_views_vary_in_zoom_field_and_place() -> None:
    known = [random_view(*rendered(), 200, np.random.default_rng(seed))[1] for seed in range(60)]
    focal = np.array([each.camera.focal_px for each in known if each.camera]) / CAMERA.focal_px
    assert focal.min() < 0.9 and focal.max() > 1.8 and 10 < (focal == 1).sum() < 40
    outside = [(each.instances == OUTSIDE).mean() for each in known]
    assert 5 < sum(share > 0 for share in outside) < 55


def test_images_of_distorting_lenses_are_not_zoomed() -> None:
    rgb, known = rendered()
    lens = Camera(200, 200, CAMERA.focal_px, 100.0, 100.0, k1=-0.1)
    bent = Annotations(known.boxes, known.poses, known.instances, camera=lens)
    for seed in range(10):
        _, after = random_view(rgb, bent, 200, np.random.default_rng(seed))
        assert after.camera == lens and np.array_equal(after.poses, known.poses)
