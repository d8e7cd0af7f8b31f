import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from shaftpose.core.errors import InputError
from shaftpose.core.geometry import Camera, cylinder_depth
from shaftpose.core.masks import crossed_share
from shaftpose.rendering.scene import Film, Lens, Scene, SceneSampler, Steel
from shaftpose.settings.schema import Distortion, Range, RenderSettings, SceneSettings

IMAGES = 12


def scenes(
    settings: RenderSettings, backgrounds: Mapping[Path, str], seed: int = 5, images: int = IMAGES
) -> list[Scene]:
    """The first candidate of each image."""
    sampler = SceneSampler(settings, tuple(backgrounds), seed)
    return [next(sampler.candidates(index)) for index in range(images)]


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


def test_occluders_lie_between_camera_and_shaft(
    with_scene: Callable[..., RenderSettings], backgrounds: Mapping[Path, str]
) -> None:
    settings = with_scene(occluder_probability=1.0)
    for scene in scenes(settings, backgrounds, images=30):
        for pose, lump in zip(scene.shafts, scene.occluders, strict=True):
            sight = np.array(lump.centre_mm) / np.linalg.norm(lump.centre_mm)
            along = np.linspace(-1, 15, 400)
            points = pose.tip_mm + along[:, None] * pose.direction
            points[:, 2] = np.maximum(points[:, 2], 4.0)  # not behind the camera
            distances = np.linalg.norm(points, axis=1)
            # A point near the tip lies on the lump's line of sight, farther away.
            behind = np.argmax(points @ sight / distances)
            assert points[behind] @ sight / distances[behind] > 0.999
            assert distances[behind] > np.linalg.norm(lump.centre_mm)


def test_light_and_steel_lie_within_their_ranges(
    settings: RenderSettings, backgrounds: Mapping[Path, str]
) -> None:
    for scene in scenes(settings, backgrounds):
        assert len(scene.steels) == len(scene.shafts)
        for steel in scene.steels:
            assert_within(steel.grey, settings.scene.steel_grey)
            assert_within(steel.roughness, settings.scene.roughness)
            assert_within(steel.scratches, settings.scene.scratches)
        assert_within(scene.light.strength, settings.scene.light_strength)
        assert_within(scene.light.kelvin, settings.scene.light_kelvin)
        assert_within(scene.light.ambient, settings.scene.ambient)


def test_lens_lies_within_its_ranges(
    settings: RenderSettings, backgrounds: Mapping[Path, str]
) -> None:
    effects = {"blur_px": (0.5, 1.4), "haze": (0.1, 0.4), "vignette": (0.3, 0.8),
               "noise": (2.0, 6.0), "motion_px": (3.0, 8.0), "jpeg_quality": (40, 80)}  # fmt: skip
    lens = replace(settings.lens, **effects)
    for scene in scenes(replace(settings, lens=lens), backgrounds):
        assert_within(scene.lens.blur_px, lens.blur_px)
        assert_within(scene.lens.haze, lens.haze)
        assert_within(scene.lens.vignette, lens.vignette)
        assert_within(scene.lens.noise, lens.noise)
        assert_within(np.hypot(*scene.lens.motion_px), lens.motion_px)
        assert scene.lens.jpeg_quality in range(40, 81)
    for scene in scenes(settings, backgrounds):
        assert scene.lens == Lens(blur_px=0.0, haze=0.0, vignette=0.0, noise=0.0)


def assert_within(value: float, ends: Range) -> None:
    assert ends[0] <= value <= ends[1]


def test_facts_survive_json(
    with_scene: Callable[..., RenderSettings], backgrounds: Mapping[Path, str]
) -> None:
    for scene in scenes(with_scene(occluder_probability=1.0), backgrounds):
        facts = json.loads(json.dumps(scene.facts()))
        assert facts["light"] == vars(scene.light)
        assert [Steel(**steel) for steel in facts["steels"]] == list(scene.steels)
        assert facts["occluders"][0]["shape_seed"] == scene.occluders[0].shape_seed
        assert tuple(facts["occluders"][0]["centre_mm"]) == scene.occluders[0].centre_mm
        assert facts["tries"] == scene.tries


# Part of the settings, option, a value that turns it on, and the parts of a scene that it decides.
OPTIONS: list[tuple[str, str, Any, str]] = [
    ("scene", "occluder_probability", 1.0, "occluders"),
    ("scene", "anisotropy", (0.2, 0.8), "anisotropies"),
    ("scene", "films", (0.1, 0.4), "films"),
    ("scene", "coating_probability", 0.5, "coatings"),
    ("scene", "jaws_probability", 0.5, "jaws"),
    ("scene", "contact_shadow", (0.3, 0.6), "contact_shadow"),
    ("lens", "blur_px", (0.5, 1.4), "blur_px"),
    ("lens", "haze", (0.1, 0.4), "haze"),
    ("lens", "vignette", (0.3, 0.8), "vignette"),
    ("lens", "noise", (2.0, 6.0), "noise"),
    ("lens", "motion_px", (1.0, 5.0), "motion_px"),
    ("lens", "jpeg_quality", (40, 90), "jpeg_quality"),
    # So weak that it rejects no pose of these images.
    ("lens", "distortion", Distortion((-0.02, -0.01), (0.0, 0.01)), "camera"),
    ("lens", "field_px", 420.0, "camera"),  # all except the corners
]


def with_option(settings: RenderSettings, part: str, name: str, value: Any) -> RenderSettings:
    return replace(settings, **{part: replace(getattr(settings, part), **{name: value})})


def with_all_options(settings: RenderSettings) -> RenderSettings:
    """All options beyond the paper's setting, except crossing shafts."""
    for part, name, value, _ in OPTIONS:
        settings = with_option(settings, part, name, value)
    return replace(settings, shaft=replace(settings.shaft, tip="rounded"))


def test_the_papers_setting_states_no_option(
    settings: RenderSettings, backgrounds: Mapping[Path, str], camera: Camera
) -> None:
    for scene in scenes(settings, backgrounds):
        assert scene.facts().keys() == {"light", "steels", "occluders", "lens", "tries"}
        assert scene.facts()["lens"].keys() == {"blur_px", "haze", "vignette", "noise"}
        for steel in scene.facts()["steels"]:
            assert steel.keys() == {"grey", "roughness", "scratches", "grain"}
        assert not any(scene.rolls_deg)
        assert scene.camera == camera
    for scene in scenes(with_all_options(settings), backgrounds):
        facts = json.loads(json.dumps(scene.facts()))
        assert {"motion_px", "jpeg_quality"} <= facts["lens"].keys()
        assert all(steel["anisotropy"] >= 0.2 for steel in facts["steels"])
        assert [Film(**film | {"pattern_mm": tuple(film["pattern_mm"])})
                for film in facts["films"]] == list(scene.films)  # fmt: skip
        for stated, coating in zip(facts["coatings"], scene.coatings, strict=True):
            assert stated == (coating and asdict(coating) | {"rgb": list(coating.rgb)})
        assert len(facts["jaws"]) == len(scene.shafts)
        assert 0.3 <= facts["contact_shadow"] <= 0.6


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


def test_every_shaft_has_a_film_of_its_own(
    with_scene: Callable[..., RenderSettings], backgrounds: Mapping[Path, str]
) -> None:
    settings = with_scene(films=(0.1, 0.4))
    drawn = scenes(settings, backgrounds)
    assert all(len(scene.films) == len(scene.shafts) for scene in drawn)
    films = [film for scene in drawn for film in scene.films]
    assert {film.blood for film in films} == {False, True}
    assert len({film.pattern_mm for film in films}) == len(films)
    for film in films:
        assert_within(film.coverage, settings.scene.films)


def test_coatings_and_jaws_follow_their_probabilities(
    with_scene: Callable[..., RenderSettings], backgrounds: Mapping[Path, str]
) -> None:
    settings = with_scene(coating_probability=0.7, jaws_probability=0.3, coating_grey=(0.01, 0.1))
    drawn = scenes(settings, backgrounds, images=100)
    coatings = [coating for scene in drawn for coating in scene.coatings]
    jaws = [one for scene in drawn for one in scene.jaws]
    assert np.mean([coating is not None for coating in coatings]) == pytest.approx(0.7, abs=0.1)
    assert np.mean([one is not None for one in jaws]) == pytest.approx(0.3, abs=0.1)
    greys = [np.mean(coating.rgb) for coating in coatings if coating is not None]
    # Half of them are below the geometric mean of the range, give or take the colours' spread.
    assert np.mean(np.array(greys) < 0.0316) == pytest.approx(0.5, abs=0.15)
    assert min(greys) > 0.007 and max(greys) < 0.13


def test_closed_jaws_are_narrower_than_the_shaft(
    with_scene: Callable[..., RenderSettings], backgrounds: Mapping[Path, str]
) -> None:
    settings = with_scene(jaws_probability=1.0)
    drawn = scenes(settings, backgrounds, images=100)
    jaws = [one for scene in drawn for one in scene.jaws if one is not None]
    shares = np.array([one.width_mm / settings.shaft.diameter_mm for one in jaws])
    openings = np.array([one.opening_deg for one in jaws])
    assert 0.4 <= shares.min() < 0.5 and 0.9 < shares.max() <= 1
    assert openings[shares > 0.8].min() >= 15 > openings.min()


def test_cameras_lie_within_their_ranges(
    settings: RenderSettings, backgrounds: Mapping[Path, str]
) -> None:
    every = with_all_options(settings)
    cameras = [scene.camera for scene in scenes(every, backgrounds)]
    assert len(set(cameras)) == IMAGES
    for camera in cameras:
        assert_within(camera.k1, every.lens.distortion.k1)
        assert_within(camera.k2, every.lens.distortion.k2)
        assert camera.field_px == 420.0


def test_tips_are_in_the_round_field_of_view(
    settings: RenderSettings, backgrounds: Mapping[Path, str]
) -> None:
    small = replace(settings, lens=replace(settings.lens, field_px=200.0))
    for scene in scenes(small, backgrounds):
        for pose in scene.shafts:
            centre_px = scene.camera.project(pose.tip_mm) - 149.5
            assert np.hypot(*centre_px) <= 100


def test_a_roll_is_drawn_where_it_shows(
    settings: RenderSettings, backgrounds: Mapping[Path, str]
) -> None:
    forceps = replace(settings, shaft=replace(settings.shaft, tip="forceps"))
    drawn = scenes(forceps, backgrounds)
    rolls = [roll for scene in drawn for roll in scene.rolls_deg]
    assert len(rolls) == sum(len(scene.shafts) for scene in drawn)
    assert min(rolls) < 90
    assert max(rolls) > 270
    assert len(set(rolls)) == len(rolls)
    assert list(drawn[0].facts()["rolls_deg"]) == list(drawn[0].rolls_deg)


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


def test_a_crossing_shaft_hides_as_much_as_it_shall(
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
    monkeypatch.setattr("shaftpose.rendering.scene._MOST_REDRAWS", 2)
    monkeypatch.setattr("shaftpose.rendering.poses._CROSSING_TRIES", 20)
    # All shafts are parallel, next to or above one another.
    poses = replace(settings.poses, pitch_deg=(89.9, 90.0), yaw_deg=(0.0, 0.1), z_mm=(20.0, 20.1))
    scene: SceneSettings = replace(settings.scene, instruments=(1, 1), crossing_probability=1.0)
    parallel = replace(settings, poses=poses, scene=scene)
    with pytest.raises(InputError, match=r"scene\.crossing_probability") as caught:
        scenes(parallel, backgrounds, images=1)
    assert "\n" not in str(caught.value)
