"""Mirrored, turned and scaled images: pixels, boxes, poses and tips change together."""

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest

from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.core.instruments import UNKNOWN, Annotations
from shaftpose.dataset.geometric_transforms import (
    mirrored_x,
    mirrored_y,
    random_similarity,
    random_symmetry,
    transposed,
)

SIDE = 200  # of images that are scaled
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


def bar(tip: tuple[float, float] = (100.0, 90.0)) -> tuple[np.ndarray, Annotations]:
    """A white bar from the left border to a tip, and its annotations."""
    rgb = np.zeros((SIDE, SIDE, 3), dtype=np.uint8)
    rgb[80:100, : int(tip[0])] = 255
    instances = (rgb[..., 0] > 0).astype(np.uint8)
    boxes = np.array([[0.0, 80.0, tip[0], 100.0]])
    return rgb, Annotations(boxes, None, instances, np.array([tip]))


def test_pixels_boxes_and_tips_move_together() -> None:
    rgb, known = bar()
    turns = set()
    for seed in range(40):
        image, changed = random_similarity(rgb, known, np.random.default_rng(seed))
        assert changed.instances is not None and changed.tips_px is not None
        differences = np.abs(image[..., 0] / 255 - changed.instances)
        assert np.count_nonzero(differences > 0.6) <= 4  # interpolated pixels of corners
        rows, columns = np.nonzero(changed.instances)
        ends = [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
        np.testing.assert_array_equal(changed.boxes, [ends])
        turns.add(round(float(np.degrees(np.arctan2(*(changed.tips_px[0] - SIDE / 2)))) / 30))
        assert np.all((changed.tips_px >= 0) & (changed.tips_px <= SIDE))
    assert len(turns) > 6


def test_a_tip_moves_as_the_pixels_around_it() -> None:
    """A disc about the tip stays one: its centroid, computed from pixels, is the tip."""
    at = np.array([100.0, 90.0])
    centres = np.stack(np.meshgrid(np.arange(SIDE), np.arange(SIDE)), axis=-1) + 0.5
    disc = np.linalg.norm(centres - at, axis=-1) < 12
    rgb = np.repeat(np.where(disc, 255, 0).astype(np.uint8)[..., None], 3, axis=2)
    known = Annotations(
        np.array([[88.0, 78.0, 112.0, 102.0]]), None, disc.astype(np.uint8), at[None]
    )
    moved = 0
    for seed in range(20):
        image, changed = random_similarity(rgb, known, np.random.default_rng(seed))
        assert changed.tips_px is not None
        if np.any((changed.tips_px < 25) | (changed.tips_px > SIDE - 25)):
            continue  # the disc may be cut
        moved += 1
        weights = image[..., 0].astype(float)
        centroid = (weights[..., None] * centres).sum(axis=(0, 1)) / weights.sum()
        np.testing.assert_allclose(changed.tips_px[0], centroid, atol=0.1)
    assert moved > 10


def zoom(known: Annotations, changed: Annotations) -> float:
    """The scale of the change: the bar is 20 px wide, cut bars keep their width."""
    assert known.instances is not None and changed.instances is not None
    # The widest inscribed circle of a bar has its width as diameter.
    widths = [
        cv2.distanceTransform(np.pad(part.instances, 1), cv2.DIST_L2, 5).max()
        for part in (known, changed)
        if part.instances is not None
    ]
    return float(widths[1] / widths[0])


def test_scales_and_places_vary() -> None:
    rgb, known = bar()
    scales = [
        zoom(known, random_similarity(rgb, known, np.random.default_rng(seed))[1])
        for seed in range(60)
    ]
    assert min(scales) < 0.95 and max(scales) > 1.4
    assert min(scales) > 0.75 and max(scales) < 1.7


def test_unknown_pixels_and_unknown_tips_stay_unknown() -> None:
    rgb, known = bar()
    assert known.instances is not None
    instances = known.instances.copy()
    instances[:, 150:] = UNKNOWN
    hidden = replace(known, instances=instances, tips_px=np.full((1, 2), np.nan))
    _, changed = random_similarity(rgb, hidden, np.random.default_rng(3))
    assert changed.instances is not None and changed.tips_px is not None
    assert set(np.unique(changed.instances)) <= {0, 1, UNKNOWN}
    assert np.isnan(changed.tips_px).all()


def test_no_tip_enters_or_leaves_the_view() -> None:
    """The first tip is out of view and might be drawn into it; the second is in its corner."""
    rgb, known = bar()
    tips = np.array([[-10.0, 90.0], [199.0, 199.0]])
    changes = 0
    for seed in range(40):
        image, after = random_similarity(
            rgb, replace(known, tips_px=tips), np.random.default_rng(seed)
        )
        assert after.tips_px is not None
        inside = np.all((after.tips_px >= 0) & (after.tips_px <= SIDE), axis=1)
        assert inside.tolist() == [False, True]
        changes += image is not rgb
    assert changes > 10


@pytest.mark.parametrize(
    "change",
    [
        pytest.param({"poses": np.ones((1, 5))}, id="poses are known"),
        pytest.param({"instances": None}, id="no map of instruments"),
        pytest.param({"instances": np.full((SIDE, SIDE), UNKNOWN, np.uint8)}, id="no mask"),
    ],
)
def test_what_cannot_be_changed_stays(change: dict[str, np.ndarray | None]) -> None:
    rgb, known = bar()
    before = replace(known, **change)
    image, after = random_similarity(rgb, before, np.random.default_rng(0))
    assert image is rgb and after is before


def test_an_image_without_a_shaft_is_changed_too() -> None:
    rgb = np.random.default_rng(0).integers(0, 255, (SIDE, SIDE, 3), dtype=np.uint8)
    empty = Annotations(np.zeros((0, 4)), None, np.zeros((SIDE, SIDE), np.uint8), None)
    image, changed = random_similarity(rgb, empty, np.random.default_rng(0))
    assert not np.array_equal(image, rgb)
    assert changed.boxes.shape == (0, 4)
