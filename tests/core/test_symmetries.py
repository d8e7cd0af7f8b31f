"""Mirrored and turned images: pixels, boxes, poses and tips change together."""

from collections.abc import Callable

import numpy as np
import pytest

from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.core.instruments import Annotations
from shaftpose.core.symmetries import (
    mirrored_x,
    mirrored_y,
    random_symmetry,
    transposed,
)

Symmetry = Callable[[np.ndarray, Annotations], tuple[np.ndarray, Annotations]]
CAMERA = Camera.from_field_of_view(299, 299, 95.0)
POSE = np.array([[4.0, -7.0, 22.0, 65.0, 130.0]])
BOX = np.array([[10.0, 20.0, 60.0, 90.0]])


def marked(poses: np.ndarray) -> np.ndarray:
    """A black image with white pixels at each pose's tip and at a point on its axis."""
    image = np.zeros((299, 299, 3), dtype=np.uint8)
    for values in poses:
        pose = ShaftPose(*values.tolist())
        for along_mm in (0.0, 5.0):
            point = pose.tip_mm + along_mm * pose.direction
            u, v = CAMERA.project(point[None])[0]
            image[int(v), int(u)] = 255
    return image


@pytest.mark.parametrize("symmetry", [mirrored_x, mirrored_y, transposed])
def test_the_changed_pose_projects_onto_the_changed_image(symmetry: Symmetry) -> None:
    rgb, known = symmetry(marked(POSE), Annotations(BOX, POSE))
    assert known.poses is not None
    assert not np.array_equal(known.poses, POSE)
    np.testing.assert_array_equal(rgb, marked(known.poses))


def test_poses_by_hand() -> None:
    before = Annotations(BOX, POSE)
    image = np.zeros((299, 299, 3), dtype=np.uint8)
    expected: dict[Symmetry, tuple[list[int], list[int]]] = {
        mirrored_x: ([-4, -7, 22, 65, 50], [239, 20, 289, 90]),
        mirrored_y: ([4, 7, 22, 65, 230], [10, 209, 60, 279]),
        transposed: ([-7, 4, 22, 65, 320], [20, 10, 90, 60]),
    }
    for symmetry, (pose, box) in expected.items():
        known = symmetry(image, before)[1]
        np.testing.assert_allclose(known.poses, [pose])
        np.testing.assert_allclose(known.boxes, [box])


def test_tips_move_like_projected_poses() -> None:
    image = np.zeros((299, 299, 3), dtype=np.uint8)
    tips = CAMERA.project(POSE[:, :3])
    for symmetry in (mirrored_x, mirrored_y, transposed):
        known = symmetry(image, Annotations(BOX, POSE, tips_px=tips))[1]
        assert known.poses is not None
        np.testing.assert_allclose(known.tips_px, CAMERA.project(known.poses[:, :3]))


def test_eight_symmetries_come_up_evenly_and_boxes_hold_their_pixels() -> None:
    rgb = np.zeros((299, 299, 3), dtype=np.uint8)
    rgb[20:90, 10:60] = 200
    rgb[25, 15] = 255
    seen: dict[tuple[int, ...], int] = {}
    for seed in range(400):
        turned, known = random_symmetry(rgb, Annotations(BOX, None), np.random.default_rng(seed))
        x0, y0, x1, y1 = known.boxes[0].astype(int)
        inside = np.zeros((299, 299), dtype=bool)
        inside[y0:y1, x0:x1] = True
        np.testing.assert_array_equal(turned[..., 0] > 0, inside)
        assert known.poses is None and turned.flags.c_contiguous
        place = tuple(int(n) for n in np.argwhere(turned[..., 0] == 255)[0])
        seen[place] = seen.get(place, 0) + 1
    assert len(seen) == 8
    assert min(seen.values()) > 25  # the mean is 50
