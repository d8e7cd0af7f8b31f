"""Sampled scenes: reproducible, and independent of options that are not their own."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from shaftpose.core.cylinder import cylinder_depth
from shaftpose.core.errors import InputError
from shaftpose.core.masks import crossed_share
from shaftpose.rendering.scene import Scene
from shaftpose.rendering.scene_sampler import SceneSampler
from shaftpose.settings.schema import RenderSettings, SceneSettings
from tests.rendering.drawn_scenes import IMAGES, OPTIONS, scenes, with_all_options, with_option


def test_an_image_depends_on_seed_and_index_alone(
    occluded_settings: RenderSettings, backgrounds: Mapping[Path, str]
) -> None:
    expected = scenes(occluded_settings, backgrounds)
    sampler = SceneSampler(occluded_settings, tuple(backgrounds), 5)
    for index in (9, 2, 9, 0):
        assert next(sampler.candidates(index)) == expected[index]


def test_images_and_seeds_differ(settings: RenderSettings, backgrounds: Mapping[Path, str]) -> None:
    drawn = scenes(settings, backgrounds) + scenes(settings, backgrounds, seed=6)
    assert len({scene.shafts for scene in drawn}) == 2 * IMAGES
    assert len({scene.sensor_seed for scene in drawn}) == 2 * IMAGES


def test_candidates_of_an_image_are_a_fixed_sequence(
    settings: RenderSettings, backgrounds: Mapping[Path, str]
) -> None:
    sampler = SceneSampler(settings, tuple(backgrounds), 5)
    first, again = (list(islice(sampler.candidates(3), 4)) for _ in range(2))
    assert first == again
    assert len({scene.shafts for scene in first}) == 4


def test_tries_count_those_of_earlier_candidates(
    settings: RenderSettings, backgrounds: Mapping[Path, str]
) -> None:
    sampler = SceneSampler(settings, tuple(backgrounds), 5)
    tries = [0, *(scene.tries for scene in islice(sampler.candidates(3), 4))]
    scenes_shafts = [len(scene.shafts) for scene in islice(sampler.candidates(3), 4)]
    # Each candidate takes one draw of its shafts at least.
    assert all(b - a >= n for a, b, n in zip(tries, tries[1:], scenes_shafts, strict=False))


def test_candidates_keep_the_numbers_of_the_first(
    with_scene: Callable[..., RenderSettings], backgrounds: Mapping[Path, str]
) -> None:
    settings = with_scene(occluder_probability=0.5, crossing_probability=0.5, instruments=(1, 2))
    sampler = SceneSampler(settings, tuple(backgrounds), 5)
    numbers = [
        {(len(s.shafts), len(s.occluders), s.crossing) for s in islice(sampler.candidates(k), 4)}
        for k in range(12)
    ]
    assert all(len(found) == 1 for found in numbers)  # else often rejected scenes would be rare
    assert len(set.union(*numbers)) > 4


@pytest.mark.parametrize("counts", [(0, 0), (1, 1), (1, 3)])
def test_every_number_of_shafts_in_the_range_occurs(
    with_scene: Callable[..., RenderSettings],
    backgrounds: Mapping[Path, str],
    counts: tuple[int, int],
) -> None:
    drawn = scenes(with_scene(instruments=counts), backgrounds)
    assert {len(scene.shafts) for scene in drawn} == set(range(counts[0], counts[1] + 1))


def test_every_background_is_used(
    settings: RenderSettings, backgrounds: Mapping[Path, str]
) -> None:
    used = {scene.background for scene in scenes(settings, backgrounds)}
    assert used == set(backgrounds)


def test_occluders_follow_their_probability(
    with_scene: Callable[..., RenderSettings], backgrounds: Mapping[Path, str]
) -> None:
    counts = {
        probability: [
            (len(scene.occluders), len(scene.shafts))
            for scene in scenes(with_scene(occluder_probability=probability), backgrounds)
        ]
        for probability in (0.0, 0.5, 1.0)
    }
    assert all(lumps == 0 for lumps, _ in counts[0.0])
    assert {lumps > 0 for lumps, _ in counts[0.5]} == {False, True}
    assert all(lumps == shafts for lumps, shafts in counts[1.0])


def test_the_papers_setting_draws_what_it_always_drew(
    settings: RenderSettings, backgrounds: Mapping[Path, str]
) -> None:
    """Other numbers here would change every image of a dataset."""
    first, *_, fourth = scenes(settings, backgrounds, images=4)
    assert first.background.name == "background-2.jpg"
    pose = [-7.5836172643878506, -19.983899305556303, 36.47544831506249, 56.48037230, 251.09511112]
    np.testing.assert_allclose(first.shafts[0].as_array(), pose, rtol=1e-7)
    assert first.steels[0].grain == pytest.approx(4.227491993115486)
    assert first.light.strength == pytest.approx(19009.516631364724)
    assert (first.sensor_seed, first.tries) == (178839274, 1)
    assert fourth.shafts[1].yaw_deg == pytest.approx(282.2609473637992)
    assert fourth.steels[1].roughness == pytest.approx(0.19315681003053484)
    assert (fourth.sensor_seed, fourth.tries) == (591095495, 2)


def parts_of(scene: Scene) -> dict[str, Any]:
    """The parts of a scene that are drawn independently."""
    steels = [replace(steel, anisotropy=0.0) for steel in scene.steels]
    anisotropies = [steel.anisotropy for steel in scene.steels]
    own = {"steels": steels, "anisotropies": anisotropies}
    return {**vars(scene), **vars(scene.lens), **own, "lens": None}


@pytest.mark.parametrize(("part", "name", "value", "decided"), OPTIONS)
@pytest.mark.parametrize("others_on", [False, True])
def test_an_option_leaves_the_draws_of_everything_else(
    settings: RenderSettings,
    backgrounds: Mapping[Path, str],
    others_on: bool,
    part: str,
    name: str,
    value: Any,
    decided: str,
) -> None:
    base = with_all_options(settings) if others_on else settings
    off = getattr(getattr(settings, part), name)
    without, with_it = (
        scenes(with_option(base, part, name, state), backgrounds) for state in (off, value)
    )
    changed = set()
    for one, other in zip(map(parts_of, without), map(parts_of, with_it), strict=True):
        changed |= {key for key in one if one[key] != other[key]}
    assert changed == {decided}


def test_the_range_of_samples_decides_nothing_else(
    settings: RenderSettings, backgrounds: Mapping[Path, str]
) -> None:
    few, many = (
        scenes(replace(settings, samples=ends), backgrounds) for ends in ((6, 6), (20, 90))
    )
    assert all(one.samples < other.samples for one, other in zip(few, many, strict=True))
    assert few == [replace(scene, samples=6) for scene in many]


def test_an_option_leaves_the_later_candidates_of_an_image(
    settings: RenderSettings, backgrounds: Mapping[Path, str]
) -> None:
    every = with_all_options(settings)
    off = with_option(every, "scene", "films", (0.0, 0.0))
    one, other = (
        list(islice(SceneSampler(each, tuple(backgrounds), 5).candidates(3), 4))
        for each in (every, off)
    )
    assert [replace(scene, films=()) for scene in one] == other


def test_a_crossing_shaft_passes_before_another_and_changes_no_other(
    settings: RenderSettings, backgrounds: Mapping[Path, str]
) -> None:
    scene = replace(settings.scene, instruments=(1, 1), anisotropy=(0.2, 0.8))
    single = replace(settings, scene=scene)
    crossed = replace(single, scene=replace(single.scene, crossing_probability=1.0))
    size = settings.shaft.diameter_mm, settings.shaft.length_mm
    kept = 0
    for before, after in zip(
        scenes(single, backgrounds), scenes(crossed, backgrounds), strict=True
    ):
        first, second = after.shafts
        behind, front = (cylinder_depth(after.camera, pose, *size) for pose in (first, second))
        hidden = np.isfinite(behind) & (front < behind)
        assert hidden.any()
        least = settings.scene.min_visible_px
        assert (np.isfinite(behind) & ~hidden).sum() >= 0.8 * least  # judged on a coarse grid
        assert np.isfinite(front).sum() >= 0.8 * least
        assert len(after.steels) == len(after.rolls_deg) == 2
        assert before.steels == after.steels[:1]
        assert (before.background, before.light) == (after.background, after.light)
        kept += before.shafts[0] == first
    # A few first shafts near the camera leave no room for a crossing one and are drawn again.
    assert kept >= IMAGES / 2


def test_a_crossing_shaft_hides_the_required_share(
    with_scene: Callable[..., RenderSettings], backgrounds: Mapping[Path, str]
) -> None:
    settings = with_scene(
        instruments=(1, 1), crossing_probability=1.0, crossing_coverage=(0.3, 0.5)
    )
    size = settings.shaft.diameter_mm, settings.shaft.length_mm
    for scene in scenes(settings, backgrounds):
        behind, front = (cylinder_depth(scene.camera, pose, *size) for pose in scene.shafts)
        share = crossed_share(front < behind, [np.isfinite(behind)])
        assert 0.25 < share < 0.55  # judged on a coarse grid


def test_crossing_shafts_follow_their_probability(
    with_scene: Callable[..., RenderSettings], backgrounds: Mapping[Path, str]
) -> None:
    counts = {
        probability: [
            len(scene.shafts)
            for scene in scenes(
                with_scene(instruments=shafts, crossing_probability=probability), backgrounds
            )
        ]
        for probability, shafts in ((0.0, (1, 1)), (0.5, (1, 1)), (1.0, (0, 0)))
    }
    assert set(counts[0.0]) == {1}
    assert set(counts[0.5]) == {1, 2}
    assert set(counts[1.0]) == {0}  # nothing to cross


def test_ranges_in_which_no_shaft_crosses_are_named(
    settings: RenderSettings, backgrounds: Mapping[Path, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("shaftpose.rendering.scene_sampler._MOST_REDRAWS", 2)
    monkeypatch.setattr("shaftpose.rendering.poses._CROSSING_TRIES", 20)
    # All shafts are parallel, next to or above one another.
    poses = replace(settings.poses, pitch_deg=(89.9, 90.0), yaw_deg=(0.0, 0.1), z_mm=(20.0, 20.1))
    scene: SceneSettings = replace(settings.scene, instruments=(1, 1), crossing_probability=1.0)
    parallel = replace(settings, poses=poses, scene=scene)
    with pytest.raises(InputError, match=r"scene\.crossing_probability") as caught:
        scenes(parallel, backgrounds, images=1)
    assert "\n" not in str(caught.value)
