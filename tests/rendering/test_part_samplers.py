"""Parts of sampled scenes: within the settings' ranges, and as often as they say."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from shaftpose.rendering.scene import Lens
from shaftpose.settings.schema import RenderSettings
from tests.rendering.drawn_scenes import IMAGES, assert_within, scenes, with_all_options


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


def test_jaws_are_never_closed_and_wide_ones_open_more(
    with_scene: Callable[..., RenderSettings], backgrounds: Mapping[Path, str]
) -> None:
    settings = with_scene(jaws_probability=1.0)
    drawn = scenes(settings, backgrounds, images=100)
    jaws = [one for scene in drawn for one in scene.jaws if one is not None]
    shares = np.array([one.width_mm / settings.shaft.diameter_mm for one in jaws])
    openings = np.array([one.opening_deg for one in jaws])
    assert 0.4 <= shares.min() < 0.5 and 0.9 < shares.max() <= 1
    assert openings[shares > 0.8].min() >= 15 > openings.min() >= 8


def test_numbers_of_samples_are_log_uniform(
    settings: RenderSettings, backgrounds: Mapping[Path, str]
) -> None:
    drawn = scenes(replace(settings, samples=(4, 32)), backgrounds, images=200)
    numbers = np.array([scene.samples for scene in drawn])
    assert 4 <= numbers.min() <= 5 and 28 <= numbers.max() <= 32
    # sqrt(4 * 32) = 11.3: as many numbers below as above.
    assert np.mean(numbers <= 11) == pytest.approx(0.5, abs=0.1)
    always = scenes(replace(settings, samples=(6, 6)), backgrounds)
    assert {scene.samples for scene in always} == {6}


def test_cameras_lie_within_their_ranges(
    settings: RenderSettings, backgrounds: Mapping[Path, str]
) -> None:
    every = with_all_options(settings)
    cameras = [scene.camera for scene in scenes(every, backgrounds)]
    assert len(set(cameras)) == IMAGES
    for camera in cameras:
        assert_within(camera.k1, every.lens.distortion.k1)
        assert_within(camera.k2, every.lens.distortion.k2)
        assert camera.field == camera.disc(420.0)


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
    assert list(drawn[0].description()["rolls_deg"]) == list(drawn[0].rolls_deg)
