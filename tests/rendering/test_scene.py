import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np

from shaftpose.config import LensSettings, Range, RenderSettings
from shaftpose.rendering.scene import Scene, SceneSampler

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
            # Some point near the tip lies on the lump's line of sight, and farther off.
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
    lens = LensSettings(blur_px=(0.5, 1.4), haze=(0.1, 0.4), vignette=(0.3, 0.8), noise=(2.0, 6.0))
    for scene in scenes(replace(settings, lens=lens), backgrounds):
        assert_within(scene.lens.blur_px, lens.blur_px)
        assert_within(scene.lens.haze, lens.haze)
        assert_within(scene.lens.vignette, lens.vignette)
        assert_within(scene.lens.noise, lens.noise)
    for scene in scenes(settings, backgrounds):
        assert not any(vars(scene.lens).values())


def assert_within(value: float, ends: Range) -> None:
    assert ends[0] <= value <= ends[1]


def test_facts_survive_json(
    with_scene: Callable[..., RenderSettings], backgrounds: Mapping[Path, str]
) -> None:
    for scene in scenes(with_scene(occluder_probability=1.0), backgrounds):
        facts = json.loads(json.dumps(scene.facts()))
        assert facts["light"] == vars(scene.light)
        assert facts["steels"] == [vars(steel) for steel in scene.steels]
        assert facts["occluders"][0]["shape_seed"] == scene.occluders[0].shape_seed
        assert tuple(facts["occluders"][0]["centre_mm"]) == scene.occluders[0].centre_mm
        assert facts["tries"] == scene.tries
