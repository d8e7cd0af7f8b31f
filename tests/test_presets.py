"""Presets: values of conf/presets that replace those of params.yaml."""

import shutil
from pathlib import Path

import pytest
import yaml

from shaftpose.nested import flatten
from shaftpose.settings.compose import composed_settings
from tools.apply_preset import apply_preset

ROOT = Path(__file__).parents[1]
PRESETS = sorted((ROOT / "conf/presets").glob("*.yaml"))


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A copy of the project's settings."""
    shutil.copytree(ROOT / "conf", tmp_path / "conf", symlinks=True)
    shutil.copyfile(ROOT / "params.yaml", tmp_path / "params.yaml")
    return tmp_path


@pytest.mark.parametrize("preset", PRESETS, ids=lambda path: path.stem)
def test_presets_change_their_values_and_nothing_else(project: Path, preset: Path) -> None:
    params = project / "params.yaml"
    before, text = yaml.safe_load(params.read_text()), params.read_text()
    apply_preset(preset, params)
    after = yaml.safe_load(params.read_text())
    assert flatten(after) == flatten(before) | flatten(yaml.safe_load(preset.read_text()))
    # Same lines, same comments: only values differ.
    lines = list(zip(text.splitlines(), params.read_text().splitlines(), strict=True))
    for old, new in lines:
        assert old.split(":")[0] == new.split(":")[0]
        assert old.partition("# ")[2] == new.partition("# ")[2]
    composed_settings(project)


def test_an_unknown_key_is_named(project: Path) -> None:
    preset = project / "wrong.yaml"
    preset.write_text("scene: {colour: 1}")
    with pytest.raises(SystemExit, match=r"wrong.yaml: scene: colour: not in params.yaml; remove"):
        apply_preset(preset, project / "params.yaml")
