from collections.abc import Sequence
from functools import partial

import numpy as np
import pytest

from shaftpose.refinement.contour import Array, Contour
from shaftpose.refinement.edges import Offsets, mask_offsets
from shaftpose.refinement.fit import (
    EdgeErrors,
    Fit,
    Search,
    Stage,
    fit_pose,
    whitened,
)
from tests.core.silhouettes import CAMERA, POSES, SHAFT, soft_mask

# Of the tip in px, the logarithm of its depth, and both angles in deg.
LOOSE, USUAL = np.array([1e3, 1e3, 10.0, 1e3, 1e3]), np.array([5.0, 5.0, 0.2, 12.0, 10.0])
EXACT = EdgeErrors()
STAGES = [Stage(px) for px in (10.0, 9.0, 8.0, 7.0, 6.0, 5.0, 4.0, 3.0, 2.0, 1.5, 1.5)]


def fitted(
    start: Array,
    search: Search,
    stages: Sequence[Stage],
    prior: Array,
    errors: EdgeErrors = EXACT,
) -> Fit:
    fit = fit_pose(start, SHAFT, CAMERA, search, stages, errors, np.diag(prior**-2))
    assert fit is not None
    return fit


def test_a_mask_gives_back_its_pose() -> None:
    for pose in POSES:
        start = pose + [0.4, -0.3, 1.0, 4.0, -3.0]
        search = partial(mask_offsets, soft_mask(pose))
        fit = fitted(start, search, STAGES, LOOSE)
        assert np.all(np.abs(fit.pose - pose) < [0.05, 0.05, 0.15, 0.6, 0.2])


def test_a_stage_ends_at_its_distance_from_the_tip() -> None:
    pose = POSES[0]
    tip = CAMERA.project(pose[:3])

    def misleading_far_off(contour: Contour, reach_px: float) -> Offsets:
        far = np.linalg.norm(contour.points - tip, axis=1) > 60
        ones = np.ones(len(far))
        return Offsets(10.0 * far * contour.normals[:, 0], ones)

    near, whole = (
        fitted(pose, misleading_far_off, [stage], LOOSE).pose for stage in (Stage(1, 50), Stage(1))
    )
    assert np.allclose(near, pose)
    assert abs(whole[4] - pose[4]) > 1


def test_depth_changes_along_the_ray() -> None:
    pose = POSES[1]
    start = np.array([*(1.2 * pose[:3]), *pose[3:]])  # 20 % too far, at the same place in the image
    search = partial(mask_offsets, soft_mask(pose))
    fit = fitted(start, search, STAGES, USUAL)
    assert np.all(np.abs(fit.pose - pose) < [0.1, 0.1, 0.2, 0.6, 0.2])


def test_yaw_crosses_zero() -> None:
    pose = np.array([0.0, 0.0, 20.0, 70.0, 1.0])
    search = partial(mask_offsets, soft_mask(pose))
    for yaw_deg in (358.0, 4.0):
        start = np.array([0.0, 0.0, 20.0, 70.0, yaw_deg])
        fit = fitted(start, search, STAGES, USUAL)
        assert abs(fit.pose[4] - 1.0) < 0.2


@pytest.mark.parametrize("shared_px", [0.0, 0.2])
def test_covariance_is_that_of_repeated_fits(shared_px: float) -> None:
    """Of edges with errors of their own and, on each part, errors that they share."""
    true, rng = POSES[0], np.random.default_rng(5)

    def noise(contour: Contour, reach_px: float) -> Offsets:
        ones = np.ones(len(contour.points))
        shared = rng.normal(0, shared_px, 3) if shared_px else np.zeros(3)
        return Offsets(rng.normal(0, 1 / np.sqrt(contour.lengths)) + shared[contour.parts], ones)

    scaled = []
    for _ in range(300):
        fit = fitted(true, noise, [Stage(1.0)], LOOSE, EdgeErrors(shared_px, understated=2.0))
        scaled.append((fit.pose - true) / np.sqrt(np.diag(fit.covariance())))
    # Edges are said to err twice as much as they do.
    assert np.allclose(np.std(scaled, axis=0), 0.5, atol=0.06)
    assert np.allclose(np.mean(scaled, axis=0), 0, atol=0.1)


def test_whitened_errors_are_independent() -> None:
    information, parts = np.array([0.0, 1.0, 4.0, 25.0, 0.5]), np.array([0, 0, 0, 1, 1])
    whitening = whitened(np.eye(5), information, parts, 0.3)[1:, 1:]
    shared = 0.3**2 * (parts[1:, None] == parts[1:])
    covariance = np.diag(1 / information[1:]) + shared
    np.testing.assert_allclose(whitening @ covariance @ whitening.T, np.eye(4), atol=1e-12)


def test_what_edges_leave_open_stays_at_the_start() -> None:
    true, start = POSES[0], POSES[0] + [0.0, 0.0, 0.0, 5.0, 0.0]
    search = partial(mask_offsets, soft_mask(true))
    firm = USUAL * [1, 1, 1, 1e-4, 1]
    fit = fitted(start, search, STAGES, firm)
    assert abs(fit.pose[3] - start[3]) < 1e-3


def test_without_edges_there_is_no_fit() -> None:
    start, prior_information = POSES[0], np.diag(LOOSE**-2)
    for mask in (np.zeros((299, 299), np.float32), np.ones((299, 299), np.float32)):
        search = partial(mask_offsets, mask)
        assert fit_pose(start, SHAFT, CAMERA, search, STAGES, EXACT, prior_information) is None
    search = partial(mask_offsets, soft_mask(start))
    for nowhere in ([0.0, 0.0, -5.0, 70.0, 0.0], [60.0, 0.0, 20.0, 70.0, 0.0]):
        pose = np.array(nowhere)
        assert fit_pose(pose, SHAFT, CAMERA, search, STAGES, EXACT, prior_information) is None


def test_an_axis_that_passes_the_line_of_sight_turns_round() -> None:
    start = np.array([3.0, 0.0, 20.0, 2.0, 350.0])

    def far(contour: Contour, reach_px: float) -> Offsets:
        ones = np.ones(len(contour.points))
        return Offsets(-20 * contour.motion[:, 3], ones)

    pose = fitted(start, far, [Stage(1.0)], np.array([1e-3, 1e-3, 1e-3, 1e3, 1e-3])).pose
    assert pose[3:] == pytest.approx([8.0, 170.0], abs=0.1)  # -8 deg at 350, by the longest step


def test_pixels_of_another_size_change_no_covariance() -> None:
    random = np.random.default_rng(0).normal(size=(5, 5))
    fit = Fit(POSES[0], random @ random.T + np.eye(5), CAMERA, 0.0)
    finer = CAMERA.enlarged(3)
    same = Fit(POSES[0], fit.information_in(finer), finer, 0.0)
    np.testing.assert_allclose(same.covariance(), fit.covariance(), rtol=1e-9)
