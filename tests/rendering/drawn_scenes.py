"""Scenes drawn with and without options, for the tests of scenes."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from shaftpose.rendering.scene import Scene
from shaftpose.rendering.scene_sampler import SceneSampler
from shaftpose.settings.schema import Distortion, Range, RenderSettings

IMAGES = 12


def scenes(
    settings: RenderSettings, backgrounds: Mapping[Path, str], seed: int = 5, images: int = IMAGES
) -> list[Scene]:
    """The first candidate of each image."""
    sampler = SceneSampler(settings, tuple(backgrounds), seed)
    return [next(sampler.candidates(index)) for index in range(images)]


def assert_within(value: float, ends: Range) -> None:
    assert ends[0] <= value <= ends[1]


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
