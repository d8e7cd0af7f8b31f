"""Sampled poses, checked against dense points of the shafts' axes instead of formulas."""

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from shaftpose.core.cylinder import cylinder_depth
from shaftpose.core.errors import InputError
from shaftpose.core.geometry import Camera, ShaftPose
from shaftpose.rendering.poses import PoseSampler, SampledPoses
from shaftpose.settings.schema import PoseRanges, RenderSettings

IMAGES = 20  # of one shaft, and as many of two
STEP_MM = 0.1


@pytest.fixture(scope="module")
def sampler(camera: Camera, settings: RenderSettings) -> PoseSampler:
    return PoseSampler(camera, settings.poses, settings.shaft, settings.scene)


@pytest.fixture(scope="module")
def drawn(sampler: PoseSampler) -> list[SampledPoses]:
    rng = np.random.default_rng(1)
    return [sampler(rng, count) for count in IMAGES * (1, 2)]


def axis_points(pose: ShaftPose, length_mm: float) -> NDArray[np.float64]:
    """(N, 3) points of the axis, STEP_MM apart."""
    along = np.arange(0, length_mm + STEP_MM, STEP_MM)
    return pose.tip_mm + along[:, None] * pose.direction


def test_poses_lie_within_their_ranges(drawn: list[SampledPoses], settings: RenderSettings) -> None:
    poses = np.array([pose.as_array() for image in drawn for pose in image.poses])
    assert np.all(poses >= settings.poses.low)
    assert np.all(poses <= settings.poses.high)


def test_poses_use_their_ranges(drawn: list[SampledPoses], settings: RenderSettings) -> None:
    poses = np.array([pose.as_array() for image in drawn for pose in image.poses])
    extent = np.array(settings.poses.high) - np.array(settings.poses.low)
    assert np.all(np.ptp(poses, axis=0) > 0.6 * extent)


def test_tips_are_in_view(drawn: list[SampledPoses], camera: Camera) -> None:
    for pose in (pose for image in drawn for pose in image.poses):
        u = camera.focal_px * pose.x_mm / pose.z_mm + camera.cx
        v = camera.focal_px * pose.y_mm / pose.z_mm + camera.cy
        assert 0 <= u <= camera.width
        assert 0 <= v <= camera.height


def test_shafts_are_clear_of_the_lens(drawn: list[SampledPoses], settings: RenderSettings) -> None:
    least = settings.scene.lens_radius_mm + settings.shaft.diameter_mm / 2
    for pose in (pose for image in drawn for pose in image.poses):
        points = axis_points(pose, settings.shaft.length_mm)
        assert np.linalg.norm(points, axis=1).min() >= least


def test_the_lens_radius_refuses_poses(camera: Camera, settings: RenderSettings) -> None:
    far = PoseSampler(
        camera, settings.poses, settings.shaft, replace(settings.scene, lens_radius_mm=15.0)
    )
    rng = np.random.default_rng(2)
    for pose in (pose for _ in range(10) for pose in far(rng, 2).poses):
        points = axis_points(pose, settings.shaft.length_mm)
        assert np.linalg.norm(points, axis=1).min() >= 15.0 + settings.shaft.diameter_mm / 2


def test_shafts_of_an_image_do_not_cut_each_other(
    drawn: list[SampledPoses], settings: RenderSettings
) -> None:
    pairs = [image.poses for image in drawn if len(image.poses) == 2]
    assert pairs
    for first, second in pairs:
        # Every fifth point of one against all of the other: at most 0.25 mm off along the axis.
        a = axis_points(first, settings.shaft.length_mm)[::5]
        b = axis_points(second, settings.shaft.length_mm)
        squared = (a**2).sum(1)[:, None] + (b**2).sum(1)[None] - 2 * a @ b.T
        assert np.sqrt(squared.min()) > settings.shaft.diameter_mm


def test_enough_of_every_shaft_is_visible(
    drawn: list[SampledPoses], camera: Camera, settings: RenderSettings
) -> None:
    size = settings.shaft.diameter_mm, settings.shaft.length_mm
    for image in drawn[:20]:
        depths = np.stack([cylinder_depth(camera, pose, *size) for pose in image.poses])
        for depth in depths:
            visible = np.isfinite(depth) & (depth == depths.min(axis=0))
            # The sampler checks only every 16th pixel.
            assert visible.sum() >= 0.85 * settings.scene.min_visible_px


def test_the_visibility_threshold_refuses_poses(camera: Camera, settings: RenderSettings) -> None:
    scene = replace(settings.scene, min_visible_px=6000)
    choosy = PoseSampler(camera, settings.poses, settings.shaft, scene)
    rng = np.random.default_rng(4)
    size = settings.shaft.diameter_mm, settings.shaft.length_mm
    for _ in range(5):
        (pose,) = choosy(rng, 1).poses
        assert np.isfinite(cylinder_depth(camera, pose, *size)).sum() >= 0.85 * 6000


def test_a_seed_determines_the_poses(sampler: PoseSampler) -> None:
    first, again, other = (sampler(np.random.default_rng(seed), 2) for seed in (5, 5, 6))
    assert first == again
    assert first != other


@pytest.mark.parametrize("count", [0, 1, 3])
def test_an_image_has_as_many_shafts_as_wanted(sampler: PoseSampler, count: int) -> None:
    rng = np.random.default_rng(7)
    assert {len(sampler(rng, count).poses) for _ in range(3)} == {count}


def test_tries_count_every_drawn_shaft(drawn: list[SampledPoses]) -> None:
    assert all(
        image.tries >= len(image.poses) and image.tries % len(image.poses) == 0 for image in drawn
    )
    assert any(image.tries > len(image.poses) for image in drawn)


def test_ranges_that_show_no_shaft_are_refused(
    camera: Camera, settings: RenderSettings, monkeypatch: pytest.MonkeyPatch
) -> None:
    draws = []
    draw = PoseSampler._draw

    def counted(self: PoseSampler, rng: np.random.Generator) -> ShaftPose:
        draws.append(1)
        return draw(self, rng)

    monkeypatch.setattr(PoseSampler, "_draw", counted)
    beside = replace(settings.poses, x_mm=(300.0, 400.0))
    blind = PoseSampler(camera, beside, settings.shaft, settings.scene)
    with pytest.raises(InputError, match="10000 for a tip outside the image") as caught:
        blind(np.random.default_rng(8), 1)
    assert "poses.x_mm" in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(draws) == 10_000


NEARLY_ONE_POSE = PoseRanges(
    x_mm=(0, 0.01), y_mm=(0, 0.01), z_mm=(30, 30.01), pitch_deg=(70, 70.01), yaw_deg=(0, 0.01)
)


@pytest.mark.parametrize(
    ("scene", "shafts", "why", "setting"),
    [
        ({"lens_radius_mm": 1000.0}, 1, "cuts the lens", "scene.lens_radius_mm"),
        ({}, 2, "cut each other", "scene.instruments"),
        ({"min_visible_px": 90_000}, 1, "too few pixels", "scene.min_visible_px"),
    ],
)
def test_the_refusal_names_its_reason_and_settings(
    camera: Camera,
    with_scene: Callable[..., RenderSettings],
    monkeypatch: pytest.MonkeyPatch,
    scene: dict[str, Any],
    shafts: int,
    why: str,
    setting: str,
) -> None:
    monkeypatch.setattr("shaftpose.rendering.poses.MOST_TRIES", 20)
    settings = with_scene(**scene)
    blind = PoseSampler(camera, NEARLY_ONE_POSE, settings.shaft, settings.scene)
    with pytest.raises(InputError, match=f"refused: 20 for .*{why}") as caught:
        blind(np.random.default_rng(9), shafts)
    assert setting in str(caught.value)


def test_the_commonest_reason_comes_first(
    camera: Camera, with_scene: Callable[..., RenderSettings], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("shaftpose.rendering.poses.MOST_TRIES", 200)
    settings = with_scene(min_visible_px=90_000)
    blind = PoseSampler(camera, settings.poses, settings.shaft, settings.scene)
    with pytest.raises(InputError) as caught:
        blind(np.random.default_rng(10), 1)
    counts = [int(count) for count in re.findall(r"(\d+) for ", str(caught.value))]
    assert len(counts) > 1
    assert counts == sorted(counts, reverse=True)
    assert sum(counts) == 200
