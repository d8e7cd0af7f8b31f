"""Pictures read along a contour's normals."""

import numpy as np
import pytest

from shaftpose.refinement.contour import Contour
from shaftpose.refinement.contour_sampling import profiles, symmetric_steps


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
