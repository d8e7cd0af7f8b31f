"""Offsets of straight edges at known places, at random angles."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from shaftpose.refinement.contour import Contour
from shaftpose.refinement.edges import mask_offsets

SIDE_PX, FINER = 60, 8
SHIFTS_PX = (-0.4, -0.25, 0.0, 0.1, 0.3)


def half_plane(angle: float, shift_px: float) -> NDArray[np.float32]:
    """1 on one side of a line, `shift_px` beyond the middle of the picture along the angle."""
    at = (np.arange(SIDE_PX * FINER) + 0.5) / FINER - SIDE_PX / 2
    x, y = np.meshgrid(at, at)
    inside = (np.cos(angle) * x + np.sin(angle) * y < shift_px).astype(np.float32)
    size = (SIDE_PX, SIDE_PX)
    return np.asarray(cv2.resize(inside, size, interpolation=cv2.INTER_AREA), np.float32)


def middle(angle: float) -> Contour:
    """Samples of a line through the middle of the picture."""
    normal = np.array([np.cos(angle), np.sin(angle)])
    along = np.linspace(-15, 15, 31)[:, None] * [-normal[1], normal[0]]
    normals = np.repeat(normal[None], 31, axis=0)
    parts = np.zeros(31, np.intp)
    return Contour(SIDE_PX / 2 + along, normals, np.ones(31), np.zeros((31, 5)), parts)


def mask_errors(angle: float, reach_px: float) -> list[float]:
    found = [mask_offsets(half_plane(angle, d), middle(angle), reach_px) for d in SHIFTS_PX]
    return [float(one.px.mean()) - d for one, d in zip(found, SHIFTS_PX, strict=True)]


@pytest.mark.parametrize("angle", np.random.default_rng(3).uniform(0, 2 * np.pi, 6))
@pytest.mark.parametrize("reach_px", [1.5, 5.0])
def test_edges_of_a_mask_are_where_they_are(angle: float, reach_px: float) -> None:
    assert np.allclose(mask_errors(angle, reach_px), 0, atol=0.03)


def test_what_is_uniform_has_no_edge() -> None:
    assert mask_offsets(np.ones((SIDE_PX, SIDE_PX), np.float32), middle(0.3), 3).weights.max() == 0


def test_an_edge_the_other_way_round_is_none() -> None:
    inverted = 1 - half_plane(0.3, 0.1)
    assert mask_offsets(inverted, middle(0.3), 3).weights.max() == 0


def test_a_profile_that_leaves_the_picture_does_not_count() -> None:
    at_border = middle(0.0)._replace(points=np.tile([58.0, 30.0], (31, 1)))
    assert mask_offsets(half_plane(0.0, 28.0), at_border, 3.0).weights.max() == 0
    assert mask_offsets(half_plane(0.0, 28.0), at_border, 1.5).weights.min() > 0.5
