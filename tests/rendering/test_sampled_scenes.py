"""Sampled scenes: their poses fill the ranges, and no shaft intersects another body.

Intersection is checked with dense surface points instead of distances between axes.
"""

from collections.abc import Callable, Mapping
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from shaftpose.core.geometry import ShaftPose
from shaftpose.rendering.scene import Scene
from shaftpose.rendering.scene_sampler import SceneSampler
from shaftpose.settings.schema import RenderSettings, ShaftSettings

SCENES = 200
SEED = 12
STEP_MM = 0.2
BINS = 10

Points = NDArray[np.float64]


@pytest.fixture(scope="module")
def scenes(
    with_scene: Callable[..., RenderSettings], backgrounds: Mapping[Path, str]
) -> list[Scene]:
    """The first images of a set in which a quarter of the images has a crossing shaft."""
    settings = with_scene(crossing_probability=0.25)
    sampler = SceneSampler(settings, tuple(backgrounds), SEED)
    return [next(sampler.candidates(index)) for index in range(SCENES)]


def surface(pose: ShaftPose, shaft: ShaftSettings) -> Points:
    """Points (N, 3) on the side and on both end discs, about STEP_MM apart."""
    radius = shaft.diameter_mm / 2
    along = np.linspace(0, shaft.length_mm, round(shaft.length_mm / STEP_MM) + 1)
    around = np.linspace(0, 2 * np.pi, round(2 * np.pi * radius / STEP_MM), endpoint=False)
    rings = np.linspace(0, radius, round(radius / STEP_MM) + 1)
    side = [np.repeat(along, len(around)), np.full(len(along) * len(around), radius)]
    ends = [np.repeat([0.0, shaft.length_mm], len(rings) * len(around)),
            np.tile(np.repeat(rings, len(around)), 2)]  # fmt: skip
    z, r = np.concatenate([side, ends], axis=1)
    angle = np.resize(around, len(z))
    return (
        np.column_stack([r * np.cos(angle), r * np.sin(angle), z]) @ pose.rotation.T + pose.tip_mm
    )


def inside(points: Points, pose: ShaftPose, shaft: ShaftSettings) -> NDArray[np.bool_]:
    """Whether points (N, 3) lie in a shaft."""
    local = (points - pose.tip_mm) @ pose.rotation
    between = (local[:, 2] > 0) & (local[:, 2] < shaft.length_mm)
    return between & (np.hypot(local[:, 0], local[:, 1]) < shaft.diameter_mm / 2)


def cut(a: ShaftPose, b: ShaftPose, shaft: ShaftSettings) -> bool:
    """Whether points of either surface lie inside the other shaft."""
    return any(
        inside(surface(first, shaft), second, shaft).any() for first, second in permutations((a, b))
    )


def test_the_scenes_have_what_these_tests_need(scenes: list[Scene]) -> None:
    assert {len(scene.shafts) for scene in scenes} == {1, 2, 3}


def test_surfaces_that_cut_are_found(settings: RenderSettings) -> None:
    across = ShaftPose(-10.0, 0.0, 20.0, 90.0, 0.0)
    for gap_mm, found in ((2.9, True), (3.1, False)):
        behind = ShaftPose(0.0, -10.0, 20.0 + gap_mm, 90.0, 90.0)
        assert cut(across, behind, settings.shaft) is found
        assert cut(behind, across, settings.shaft) is found


def test_no_shaft_cuts_another(scenes: list[Scene], settings: RenderSettings) -> None:
    for scene in scenes:
        for n, pose in enumerate(scene.shafts):
            assert not any(cut(pose, other, settings.shaft) for other in scene.shafts[:n])


def test_no_shaft_cuts_the_lens(scenes: list[Scene], settings: RenderSettings) -> None:
    for pose in (pose for scene in scenes for pose in scene.shafts):
        distance = np.linalg.norm(surface(pose, settings.shaft), axis=1)
        assert distance.min() >= settings.scene.lens_radius_mm


def test_poses_reach_both_ends_of_every_range(
    scenes: list[Scene], settings: RenderSettings
) -> None:
    drawn = np.array([pose.as_array() for scene in scenes for pose in scene.shafts])
    low, high = np.array(settings.poses.low), np.array(settings.poses.high)
    share = (drawn - low) / (high - low)
    assert share.min() >= 0
    assert share.max() <= 1
    # Few poses have a z near the lower end, where little of the range of x and y is in view.
    for name, column in zip(("x", "y", "z", "pitch", "yaw"), share.T, strict=True):
        counts, _ = np.histogram(column, BINS, (0, 1))
        assert counts.all(), f"{name}: {counts}"
