import numpy as np
import pytest

from shaftpose.refinement.bound import pose_bound
from tests.core.silhouettes import CAMERA, SHAFT


def test_bound_of_a_shaft_across_the_view() -> None:
    """The two edges are lines of length l: position and slope at the end of a line fitted to values
    of variance s^2 for each px have the variances 4 s^2 / l and 12 s^2 / l^3."""
    tip_mm = 20.0
    bound = pose_bound(np.array([0.0, 0.0, tip_mm, 90.0, 0.0]), SHAFT, CAMERA)
    length_px, noise_px = CAMERA.width / 2, 5 / 60
    for_both_edges = noise_px**2 / 2
    y_px = np.sqrt(4 * for_both_edges / length_px)
    yaw_rad = np.sqrt(12 * for_both_edges / length_px**3)
    assert bound[1] == pytest.approx(y_px * tip_mm / CAMERA.focal_px, rel=0.05)
    assert bound[4] == pytest.approx(np.degrees(yaw_rad), rel=0.05)


def test_what_the_image_leaves_open_has_no_bound() -> None:
    onto_the_end = np.array([0.0, 0.0, 20.0, 0.0, 0.0])
    assert np.all(np.isinf(pose_bound(onto_the_end, SHAFT, CAMERA)))
