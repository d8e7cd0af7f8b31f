"""Strips along outlines of a picture that shows its own coordinates."""

import numpy as np

from shaftpose.refinement.contour import shaft_contour
from shaftpose.refinement.outline_strips import COLUMNS, MIDDLE, ROWS, outline_strips, scaled
from tests.core.silhouettes import CAMERA, POSES, SHAFT, SIDE_PX


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
