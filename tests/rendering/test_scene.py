"""A scene as plain values."""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path

from shaftpose.core.geometry import Camera
from shaftpose.rendering.scene import Film, Steel
from shaftpose.settings.schema import RenderSettings
from tests.rendering.drawn_scenes import (
    scenes,
    with_all_options,
)


def test_facts_survive_json(
    with_scene: Callable[..., RenderSettings], backgrounds: Mapping[Path, str]
) -> None:
    for scene in scenes(with_scene(occluder_probability=1.0), backgrounds):
        described = json.loads(json.dumps(scene.description()))
        assert described["light"] == vars(scene.light)
        assert [Steel(**steel) for steel in described["steels"]] == list(scene.steels)
        assert described["occluders"][0]["shape_seed"] == scene.occluders[0].shape_seed
        assert tuple(described["occluders"][0]["centre_mm"]) == scene.occluders[0].centre_mm
        assert described["tries"] == scene.tries


def test_the_papers_setting_states_no_option(
    settings: RenderSettings, backgrounds: Mapping[Path, str], camera: Camera
) -> None:
    for scene in scenes(settings, backgrounds):
        stated = {"light", "steels", "occluders", "lens", "tries", "samples"}
        assert scene.description().keys() == stated
        assert scene.description()["lens"].keys() == {"blur_px", "haze", "vignette", "noise"}
        for steel in scene.description()["steels"]:
            assert steel.keys() == {"grey", "roughness", "scratches", "grain"}
        assert not any(scene.rolls_deg)
        assert scene.camera == camera
    for scene in scenes(with_all_options(settings), backgrounds):
        described = json.loads(json.dumps(scene.description()))
        assert {"motion_px", "jpeg_quality"} <= described["lens"].keys()
        assert all(steel["anisotropy"] >= 0.2 for steel in described["steels"])
        assert [Film(**film | {"pattern_mm": tuple(film["pattern_mm"])})
                for film in described["films"]] == list(scene.films)  # fmt: skip
        for stated, coating in zip(described["coatings"], scene.coatings, strict=True):
            assert stated == (coating and asdict(coating) | {"rgb": list(coating.rgb)})
        assert len(described["jaws"]) == len(scene.shafts)
        assert 0.3 <= described["contact_shadow"] <= 0.6
