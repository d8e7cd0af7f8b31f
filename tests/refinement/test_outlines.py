"""Outlines of shafts that the image's border cuts, against exact silhouettes."""

from dataclasses import replace

import numpy as np
import pytest

from shaftpose.core.geometry import Camera, Disc
from shaftpose.refinement.contour import shaft_contour
from shaftpose.refinement.outlines import contour_around, visible_outline
from tests.core.silhouettes import CAMERA, POSES, SHAFT, fine_mask

# Along the right border, which it crosses: one of its lines is not in the image, nor is its tip.
ALONG_BORDER = np.array([21.0, -30.0, 20.0, 88.0, 88.0])


def covered(outline: np.ndarray) -> np.ndarray:
    """The centres of pixels inside a convex polygon (N, 2), by the side of each edge."""
    at = np.stack(np.meshgrid(*2 * [np.arange(CAMERA.width) + 0.5]), axis=-1)
    sides = []
    for start, end in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        (along_x, along_y), (x, y) = end - start, np.moveaxis(at - start, -1, 0)
        sides.append(along_x * y - along_y * x)
    return np.all(np.array(sides) >= 0, axis=0) | np.all(np.array(sides) <= 0, axis=0)


@pytest.mark.parametrize("pose", [*POSES, ALONG_BORDER])
def test_an_outline_is_that_of_the_silhouette(pose: np.ndarray) -> None:
    inside, seen = covered(visible_outline(pose, SHAFT, CAMERA)), fine_mask(pose, 1)
    assert (inside & seen).sum() / (inside | seen).sum() > 0.98


def test_a_line_out_of_sight_counts() -> None:
    contour = shaft_contour(ALONG_BORDER, SHAFT, CAMERA)
    assert set(contour.parts) in ({0}, {1})  # one line
    assert visible_outline(ALONG_BORDER, SHAFT, CAMERA).max() == CAMERA.width


def test_an_outline_ends_at_a_round_field() -> None:
    field = Disc(200.0, 149.5, 120.0)
    inside = covered(visible_outline(POSES[0], SHAFT, replace(CAMERA, field=field)))
    at = np.stack(np.meshgrid(*2 * [np.arange(CAMERA.width) + 0.5]), axis=-1)
    seen = fine_mask(POSES[0], 1) & (field.border_px(at) >= 0)
    assert (inside & seen).sum() / (inside | seen).sum() > 0.97


def test_a_shaft_out_of_sight_has_none() -> None:
    beside = np.array([60.0, 0.0, 20.0, 90.0, 90.0])
    assert len(contour_around(beside, SHAFT, CAMERA))
    behind = np.array([0.0, 0.0, -20.0, 90.0, 90.0])
    for pose in (beside, behind):
        assert visible_outline(pose, SHAFT, CAMERA).shape == (0, 2)


def test_points_around_the_image_are_those_of_a_wider_camera() -> None:
    wide = Camera(3 * 299, 3 * 299, CAMERA.focal_px, 1.5 * 299, 1.5 * 299)
    expected = shaft_contour(POSES[0], SHAFT, wide).points - 299
    np.testing.assert_allclose(contour_around(POSES[0], SHAFT, CAMERA), expected)
