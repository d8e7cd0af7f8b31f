"""Presets: files of conf/preset/, whose sections override those of params.yaml."""

import shutil
from pathlib import Path

import pytest
import yaml
from omegaconf import OmegaConf

from shaftpose.core.errors import InputError
from shaftpose.settings.compose import composed, composed_settings
from shaftpose.settings.parsing import flatten

ROOT = Path(__file__).parents[1]
PRESETS = {path.stem: path for path in (ROOT / "conf/preset").glob("*.yaml")}
SECTIONS = {"camera", "poses", "shaft", "scene", "lens"}  # which dvc.yaml lists one by one
LEFT_OUT = {"variant", "overrides"}


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A copy of the project's settings that chooses the preset `laparoscopy`."""
    shutil.copytree(ROOT / "conf", tmp_path / "conf", symlinks=True)
    params = (ROOT / "params.yaml").read_text().replace("preset: none", "preset: laparoscopy")
    (tmp_path / "params.yaml").write_text(params)
    return tmp_path


def values(root: Path, *overrides: str) -> dict[str, object]:
    """All values except the command line, and those that a variant's file takes from others."""
    config = OmegaConf.to_container(composed(root, *overrides), resolve=True)
    assert isinstance(config, dict)
    return flatten({name: part for name, part in config.items() if name not in LEFT_OUT})


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_changes_its_values_and_nothing_else(name: str) -> None:
    preset = yaml.safe_load(PRESETS[name].read_text())
    assert preset.keys() == SECTIONS and "size_px" not in preset["camera"]
    assert values(ROOT, f"preset={name}") == values(ROOT) | flatten(preset) | {"preset": name}
    composed_settings(ROOT, f"preset={name}")


def test_params_and_the_command_line_choose_the_same(project: Path) -> None:
    assert values(project) == values(ROOT, "preset=laparoscopy")
    assert values(project, "preset=none") == values(ROOT)


def test_other_values_of_the_command_line_win(project: Path) -> None:
    assert values(project, "camera.view_deg=70")["camera.view_deg"] == 70


@pytest.mark.parametrize(
    ("override", "says"),
    [("preset=none_such", "preset=none_such: .*preset/none_such"), ("seed", "seed: .*")],
)
def test_what_is_no_setting_is_named(override: str, says: str) -> None:
    with pytest.raises(InputError, match=f"^{says}") as caught:
        composed_settings(ROOT, override)
    assert "\n" not in str(caught.value)
