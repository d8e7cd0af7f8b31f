"""Profiles and strips of pictures that show their own coordinates."""

import numpy as np
import pytest

from shaftpose.refinement.contour import Contour, shaft_contour
from shaftpose.refinement.contour_sampling import (
    COLUMNS,
    MIDDLE,
    ROWS,
    outline_strips,
    profiles,
    scaled,
    symmetric_steps,
)
from tests.core.silhouettes import CAMERA, POSES, SHAFT, SIDE_PX


def contour(points: list[tuple[float, float]], normal: tuple[float, float]) -> Contour:
    count = len(points)
    normals, motion = np.tile(np.array(normal), (count, 1)), np.zeros((count, 5))
    return Contour(np.array(points), normals, np.ones(count), motion, np.zeros(count, np.intp))


def test_a_ramp_is_read_at_the_places_of_its_pixels() -> None:
    """Pixel (x, y) has its centre at x + 0.5, y + 0.5."""
    y, x = np.mgrid[:20, :30] + 0.5
    ramp = np.stack([x, y], axis=-1).astype(np.float32)
    read, inside = profiles(ramp, contour([(10.25, 8.0)], (0.6, -0.8)), np.array([-2.0, 0.0, 3.0]))
    np.testing.assert_allclose(read[0], [[9.05, 9.6], [10.25, 8.0], [12.05, 5.6]], atol=0.02)
    assert inside.tolist() == [1.0]


def test_profiles_that_leave_the_picture_are_told() -> None:
    flat, places = np.zeros((20, 30), np.float32), [(28.0, 10.0), (27.9, 10.0), (1.9, 10.0)]
    _, inside = profiles(flat, contour(places, (1.0, 0.0)), np.array([-2.0, 2.0]))
    assert inside.tolist() == [1.0, 1.0, 0.0]


@pytest.mark.parametrize(("reach_px", "count"), [(2.0, 4), (2.1, 5)])
def test_steps_reach_at_least_as_far_as_asked(reach_px: float, count: int) -> None:
    assert symmetric_steps(reach_px, 0.5) == pytest.approx(0.5 * np.arange(-count, count + 1))


def coordinates() -> np.ndarray:
    """The centre of each pixel: x, y, 0."""
    y, x = np.mgrid[:SIDE_PX, :SIDE_PX] + 0.5
    return np.stack([x, y, np.zeros_like(x)], axis=-1).astype(np.float32)


def test_a_row_is_a_sample_and_a_column_a_place_along_its_normal() -> None:
    contour = shaft_contour(POSES[0], SHAFT, CAMERA)
    strips = outline_strips(coordinates(), contour, step_px=0.5)
    assert strips.colours.shape == (3, ROWS, COLUMNS, 3)
    assert strips.used.sum() == len(contour.points)
    for column in (0, MIDDLE, COLUMNS - 1):
        read = strips.colours[..., column, :2][strips.used]
        expected = contour.points + 0.5 * (column - MIDDLE) * contour.normals
        seen = strips.inside > 0
        np.testing.assert_allclose(read[seen], expected[seen], atol=0.02)
    assert np.all(strips.colours[~strips.used] == 0)


def test_values_of_rows_are_those_of_samples() -> None:
    contour = shaft_contour(POSES[1], SHAFT, CAMERA)
    strips = outline_strips(coordinates(), contour, step_px=0.5)
    samples = np.arange(1.0, len(contour.points) + 1)
    rows = strips.of_rows(samples)
    np.testing.assert_array_equal(strips.of_samples(rows), samples)
    assert (rows > 0).sum() == len(samples)
    for number, row in zip(np.unique(contour.parts), rows, strict=True):
        np.testing.assert_array_equal(row[row > 0], samples[contour.parts == number])


def test_a_row_that_leaves_the_image_is_not_inside() -> None:
    contour = shaft_contour(POSES[0], SHAFT, CAMERA)
    strips = outline_strips(coordinates(), contour, step_px=0.5)
    reach_px = 0.5 * MIDDLE
    near_border = np.any(
        (contour.points < 0.5 * reach_px) | (contour.points > SIDE_PX - 0.5 * reach_px), axis=1
    )
    deep = np.all((contour.points > reach_px) & (contour.points < SIDE_PX - reach_px), axis=1)
    assert near_border.any()
    assert np.all(strips.inside[deep] == 1)
    assert np.any(strips.inside[near_border] == 0)


def test_grey_levels_are_scaled_to_the_networks_range() -> None:
    assert scaled(np.array([[[0, 127, 255]]], np.uint8)).tolist() == [
        [[-1.0, np.float32(127) / np.float32(127.5) - 1, 1.0]]
    ]
