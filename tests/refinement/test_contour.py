from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from shaftpose.core.geometry import Disc, axis_direction
from shaftpose.refinement.contour import shaft_contour
from tests.core.silhouettes import CAMERA, FINER, POSES, SHAFT, SIDE_PX, fine_mask

Array = NDArray[np.float64]


@pytest.mark.parametrize("pose", POSES, ids=["middle", "border", "behind", "end"])
def test_points_lie_on_the_border_of_the_silhouette(pose: Array) -> None:
    contour, mask = shaft_contour(pose, SHAFT, CAMERA), fine_mask(pose)
    assert len(contour.points) > 50
    for shift_px, expected in ((-0.4, True), (0.4, False)):
        at = (FINER * (contour.points + shift_px * contour.normals)).astype(int)
        inside = np.all((at >= 0) & (at < FINER * SIDE_PX), axis=1)
        assert np.all(mask[at[inside, 1], at[inside, 0]] == expected)
    assert np.allclose(np.linalg.norm(contour.normals, axis=1), 1)


@pytest.mark.parametrize("pose", POSES, ids=["middle", "border", "behind", "end"])
@pytest.mark.parametrize("dimension", range(5))
def test_motion_is_the_displacement_along_the_normals(pose: Array, dimension: int) -> None:
    step = np.zeros(5)
    step[dimension] = 1e-3
    contour = shaft_contour(pose, SHAFT, CAMERA)
    ahead, behind = (shaft_contour(pose + s * step, SHAFT, CAMERA) for s in (1, -1))
    moved = _beyond(ahead.points, ahead.normals, contour) - _beyond(
        behind.points, behind.normals, contour
    )
    assert np.allclose(moved / 2e-3, contour.motion[:, dimension], atol=2e-2)


def _beyond(points: Array, normals: Array, contour: object) -> Array:
    """Distance of the nearest tangent of other samples from each sample, along its normal."""
    own, direction = contour.points, contour.normals  # type: ignore[attr-defined]
    near = np.linalg.norm(own[:, None] - points[None], axis=-1)
    near += 1e3 * (direction @ normals.T < 0.9)
    twin = near.argmin(axis=1)
    return np.sum((points[twin] - own) * normals[twin], axis=1) / np.sum(
        direction * normals[twin], axis=1
    )


def test_only_a_flat_tip_has_a_rim() -> None:
    pose = POSES[0]
    lines = shaft_contour(pose, SHAFT._replace(flat_tip=False), CAMERA)
    both = shaft_contour(pose, SHAFT, CAMERA)
    assert 0 < len(lines.points) < len(both.points)
    course = CAMERA.project(pose[:3] + axis_direction(pose[3], pose[4])) - CAMERA.project(pose[:3])
    course /= np.linalg.norm(course)
    assert np.all(np.abs(lines.normals @ course) < 0.3)
    rim = both.normals[len(lines.points) :]
    assert np.all(rim @ course < -0.3)  # away from the handle


def test_normals_leave_a_shaft_that_passes_close_to_the_camera() -> None:
    pose = np.array([2.46, -10.35, 6.27, 56.51, 114.39])  # the axis is 2.1 mm away
    contour, mask = shaft_contour(pose, SHAFT, CAMERA), fine_mask(pose)
    assert len(contour.points) > 30
    at = (FINER * (contour.points - 0.5 * contour.normals)).astype(int)
    seen = np.all((at >= 0) & (at < FINER * SIDE_PX), axis=1)
    assert np.all(mask[at[seen, 1], at[seen, 0]])


def test_a_line_ends_with_the_shaft() -> None:
    pose = np.array([0.0, 0.0, 30.0, 90.0, 0.0])  # across the view, 10 mm long
    contour = shaft_contour(pose, SHAFT._replace(length_mm=10.0), CAMERA)
    end = CAMERA.project(np.array([10.0, 0.0, 30.0]))[0]
    assert end - 3 < contour.points[:, 0].max() < end + 1
    start = CAMERA.project(pose[:3])[0]
    around = 2 * (end - start) + CAMERA.focal_px * SHAFT.diameter_mm / 30  # two lines and the tip
    assert contour.lengths.sum() == pytest.approx(around, rel=0.1)


@pytest.mark.parametrize(
    "pose",
    [
        [0.0, 0.0, 20.0, 0.0, 0.0],  # the camera is on the axis
        [0.0, 0.0, 0.5, 70.0, 0.0],  # the tip is at the lens
        [0.0, 0.0, -20.0, 70.0, 0.0],
        [0.0, 0.0, np.nan, 70.0, 0.0],
    ],
)
def test_poses_without_a_contour(pose: list[float]) -> None:
    contour = shaft_contour(np.array(pose), SHAFT, CAMERA)
    assert [len(part) for part in contour[:5]] == [0, 0, 0, 0, 0]


def test_a_contour_ends_at_the_border_of_a_round_field() -> None:
    camera = replace(CAMERA, field=Disc(170.0, 149.5, 180.0))
    pose = np.array([0.0, 0.0, 20.0, 80.0, 0.0])
    whole, part = (shaft_contour(pose, SHAFT, each) for each in (CAMERA, camera))
    assert (whole.points[:, 0] > 270).any()
    assert (camera.border_px(part.points) >= 0).all()
    assert part.points[:, 0].max() > 250  # 260 at the height of the circle's centre
    ends = np.array([part.points[part.parts == side][-1] for side in (0, 1)])
    assert (camera.border_px(ends) < 3).all()
