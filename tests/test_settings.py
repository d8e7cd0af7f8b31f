"""Settings: refused values, error messages, and conversion to and from JSON."""

from pathlib import Path
from typing import Any

import pytest
import yaml

from shaftpose.core.errors import InputError
from shaftpose.settings.parsing import flatten, parse, to_json
from shaftpose.settings.schema import (
    Augmentation,
    CadSettings,
    ClusterSettings,
    LensSettings,
    LossSettings,
    PoseRanges,
    RenderSettings,
    RunSize,
    SceneSettings,
    ShaftSettings,
    SplitSettings,
    TrainingSettings,
)
from shaftpose.stage_files import read_stage_file

ROOT = Path(__file__).parents[1]
PARAMS = yaml.safe_load((ROOT / "params.yaml").read_text())
PROFILES = yaml.safe_load((ROOT / "conf/profiles.yaml").read_text())


def render_values() -> dict[str, Any]:
    names = ("camera", "poses", "shaft", "scene", "lens")
    return {
        **{name: PARAMS[name] for name in names},
        "samples": PROFILES["smoke"]["samples"],
        "jpeg_quality": PARAMS["render"]["jpeg_quality"],
    }


def complaint(kind: type, values: dict[str, Any]) -> str:
    """The message of a refusal, which is one line."""
    with pytest.raises(InputError) as caught:
        parse(kind, values, "params.yaml: part.")
    message = str(caught.value)
    assert "\n" not in message
    return message


@pytest.mark.parametrize(
    ("kind", "part", "key", "value"),
    [
        (LossSettings, "loss", "alpha", "much"),  # wrong type
        (LossSettings, "loss", "alpha", -0.5),
        (LossSettings, "loss", "gamma", 0.0),
        (LossSettings, "loss", "beta", [1.0, 1.0, 2.0, 2.0, 2.0, 2.0]),
        (LossSettings, "loss", "delta", 3.0),  # unknown key
        (SceneSettings, "scene", "instruments", [2, 1]),  # upside down
        (SceneSettings, "scene", "light_strength", [20000.0, 1000.0]),
        (SceneSettings, "scene", "roughness", [0.1, 1.4]),  # leaves [0, 1]
        (SceneSettings, "scene", "min_visible_px", 0),
        (SceneSettings, "scene", "occluder_probability", 1.5),
        (SceneSettings, "scene", "occluder_coverage", [0.5, 0.2]),
        (SceneSettings, "scene", "crossing_probability", -0.1),
        (SceneSettings, "scene", "crossing_coverage", [0.5, 1.2]),
        (SceneSettings, "scene", "light_kelvin", [2700.0, 5000.0]),
        (SceneSettings, "scene", "light_shape", "square"),
        (SceneSettings, "scene", "anisotropy", [0.0, 1.2]),
        (SceneSettings, "scene", "films", [0.5, 0.2]),
        (SceneSettings, "scene", "contact_shadow", [-0.1, 0.5]),
        (LensSettings, "lens", "motion_px", [-1.0, 2.0]),
        (LensSettings, "lens", "jpeg_quality", [0, 90]),
        (LensSettings, "lens", "jpeg_quality", [90, 60]),
        (LensSettings, "lens", "field_px", 0),
        (ShaftSettings, "shaft", "tip", "pointed"),
        (ShaftSettings, "shaft", "jaw_angle_deg", 180.0),
        (ShaftSettings, "shaft", "bevel_mm", 0.0),
        (SplitSettings, "split", "method", "alphabetical"),
        (SplitSettings, "split", "test", 1.0),
        (ClusterSettings, "cluster", "workers", 0),
        (ClusterSettings, "cluster", "hang_s", 0),
    ],
)
def test_a_wrong_value_is_named(kind: type, part: str, key: str, value: object) -> None:
    parse(kind, PARAMS[part], "params.yaml: ")  # valid without the change
    message = complaint(kind, {**PARAMS[part], key: value})
    ends = enumerate(value) if isinstance(value, list) else ()
    named = {key: value} | {f"{key}.{n}": end for n, end in ends}
    assert any(message.startswith(f"params.yaml: part.{k} = {v!r}: ") for k, v in named.items())


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ({"x_mm": [20.0, -20.0]}, "poses.x_mm = [20.0, -20.0]"),
        ({"x_mm": [1.0]}, "poses.x_mm.1 is missing"),
        ({"x_mm": ["left", 2.0]}, "poses.x_mm.0 = 'left'"),
        ({"roll_deg": [0.0, 1.0]}, "poses.roll_deg = [0.0, 1.0]"),
    ],
)
def test_a_wrong_value_deep_inside_is_named(values: dict[str, Any], named: str) -> None:
    poses = {**PARAMS["poses"], **values}
    assert f"part.{named}" in complaint(RenderSettings, {**render_values(), "poses": poses})


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ({"file": "a.stl"}, "shaft.cad.unit is missing"),
        ({"file": "a.stl", "unit": "feet"}, "shaft.cad.unit = 'feet'"),
        ({"file": "a.stl", "unit": "mm", "axis": "w"}, "shaft.cad.axis = 'w'"),
        ({"file": "a.stl", "unit": "mm", "tip": "left"}, "shaft.cad.tip = 'left'"),
        ("a.stl", "shaft.cad = 'a.stl'"),
    ],
)
def test_a_wrong_value_of_a_cad_file_is_named(values: object, named: str) -> None:
    shaft = {**PARAMS["shaft"], "cad": values}
    assert f"part.{named}" in complaint(RenderSettings, {**render_values(), "shaft": shaft})


def test_a_cad_file_needs_a_name_and_a_unit() -> None:
    cad = parse(CadSettings, {"file": "a.stl", "unit": "mm"}, "here")
    assert (cad.file, cad.axis, cad.tip) == (Path("a.stl"), None, None)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("loader_workers", -1),
        ("loader_workers", 1.5),
        ("checkpoint_minutes", -1),
        ("max_hours", 0),
        ("on_damaged", "maybe"),
        ("gradient_clip", 0),
        ("ema_decay", 1.0),
        ("compile", "later"),
    ],
)
def test_a_wrong_count_is_named(key: str, value: float) -> None:
    message = complaint(TrainingSettings, {**PARAMS["training"], key: value})
    assert message.startswith(f"params.yaml: part.{key} = {value!r}: ")


SLURM = {"queue": "long", "cores": 32, "memory": "64GB", "walltime": "12:00:00", "jobs": 4}


@pytest.mark.parametrize("memory", ["64GB", "64 GB", "500MiB"])
def test_slurm_jobs_are_part_of_the_cluster(memory: str) -> None:
    slurm = {**SLURM, "memory": memory}
    found = parse(ClusterSettings, {**PARAMS["cluster"], "slurm": slurm}, "here").slurm
    assert found is not None
    assert (found.cores, found.memory) == (32, memory)


# YAML reads 12:00:00 without quotes as a number of seconds.
@pytest.mark.parametrize(("key", "value"), [("memory", "64"), ("walltime", 43200), ("jobs", 0)])
def test_what_slurm_would_not_understand_is_named(key: str, value: object) -> None:
    slurm = {**SLURM, key: value}
    message = complaint(ClusterSettings, {**PARAMS["cluster"], "slurm": slurm})
    assert message.startswith(f"params.yaml: part.slurm.{key} = {value!r}: ")


def test_a_scheduler_and_slurm_exclude_each_other() -> None:
    both = {"address": "tcp://10.0.0.1:8786", "slurm": SLURM}
    message = complaint(ClusterSettings, {**PARAMS["cluster"], **both})
    assert message == "params.yaml: part: address and slurm are both set; make one of them null"


@pytest.mark.parametrize(
    ("changed", "least"),
    [({"tip": "forceps", "length_mm": 12}, "12"), ({"tip": "rounded", "length_mm": 0.5}, "0.5")],
)
def test_a_shaft_shorter_than_its_tip_is_named(changed: dict[str, Any], least: str) -> None:
    message = complaint(ShaftSettings, {**PARAMS["shaft"], **changed})
    length = f"{changed['length_mm']:g}"
    assert message.startswith(
        f"params.yaml: part: length_mm = {length} must be more than {least} for the tip"
    )


def test_a_missing_key_is_named() -> None:
    values = {key: value for key, value in PARAMS["loss"].items() if key != "gamma"}
    assert complaint(LossSettings, values) == "params.yaml: part.gamma is missing; add it"
    four = {**PARAMS["loss"], "beta": [1.0, 1.0, 2.0, 2.0]}
    assert complaint(LossSettings, four) == "params.yaml: part.beta.4 is missing; add it"


def test_an_end_of_a_range_is_named() -> None:
    message = complaint(SceneSettings, {**PARAMS["scene"], "light_kelvin": [2700.0, 5000.0]})
    assert message.startswith("params.yaml: part.light_kelvin.0 = 2700.0: Input should be greater")


def test_the_words_for_a_range_upside_down() -> None:
    message = complaint(Augmentation, {**PARAMS["training"]["augmentation"], "hue_deg": [10, -10]})
    assert message == (
        "params.yaml: part.hue_deg = [10, -10]: the lower end 10 is above the upper end -10; "
        "swap them"
    )


def test_equal_ends_are_a_range() -> None:
    values = {**PARAMS["training"]["augmentation"], "hue_deg": [5, 5]}
    assert parse(Augmentation, values, "here").hue_deg == (5.0, 5.0)


def test_every_profile_is_a_size() -> None:
    sizes = {name: parse(RunSize, values, name) for name, values in PROFILES.items()}
    assert sizes["paper"].images == 100_000
    assert sizes["paper"].width == 1.0
    every = {name: size.validate_every for name, size in sizes.items()}
    assert every == {"smoke": 3, "demo": 500, "bench": 3000, "laparoscopy": 1500, "paper": 5000}


def test_a_size_that_is_never_validated_is_refused() -> None:
    message = complaint(RunSize, {**PROFILES["smoke"], "validate_every": 0})
    assert message.startswith("params.yaml: part.validate_every = 0: ")


def test_a_round_field_in_the_pixels_of_another_image_is_refused() -> None:
    values = render_values()
    values["lens"] = {**values["lens"], "field_px": 1000}
    message = complaint(RenderSettings, values)
    # 299 px sqrt(2) = 422.85 px
    assert "lens.field_px = 1000 has no effect: the diagonal of the rendered image" in message
    assert "423" in message
    values["lens"]["field_px"] = 420
    assert parse(RenderSettings, values, "here").lens.field_px == 420


def test_a_warm_up_as_long_as_the_training_is_refused() -> None:
    values = {**PROFILES["smoke"], "steps": 300, "warmup_steps": 200, "detector_steps": 201}
    parse(RunSize, values, "here")
    message = complaint(RunSize, values | {"warmup_steps": 200, "detector_steps": 200})
    assert message == "params.yaml: part: warmup_steps = 200 must be less than detector_steps = 200"
    message = complaint(RunSize, values | {"warmup_steps": 300, "detector_steps": 400})
    assert message == "params.yaml: part: warmup_steps = 300 must be less than steps = 300"


@pytest.mark.parametrize(
    ("key", "allowed", "refused"),
    [
        ("pitch_deg", [0.0, 180.0], [-20.0, 90.0]),
        ("pitch_deg", [0.0, 180.0], [50.0, 190.0]),
        ("yaw_deg", [-180.0, 180.0], [0.0, 361.0]),
    ],
)
def test_ranges_in_which_a_shaft_has_two_poses_are_refused(
    key: str, allowed: list[float], refused: list[float]
) -> None:
    parse(PoseRanges, {**PARAMS["poses"], key: allowed}, "here")
    message = complaint(PoseRanges, {**PARAMS["poses"], key: refused})
    assert message.startswith(f"params.yaml: part.{key}")


def test_pose_ranges_in_order() -> None:
    poses = parse(RenderSettings, render_values(), "params.yaml").poses
    assert poses.low == (-20, -20, 10, 50, 0)  # the paper's ranges
    assert poses.high == (20, 20, 40, 90, 358)


def test_settings_are_frozen() -> None:
    settings = parse(LossSettings, PARAMS["loss"], "here")
    with pytest.raises(AttributeError):
        settings.alpha = 10  # type: ignore[misc]


def test_render_settings_survive_json(tmp_path: Path) -> None:
    settings = parse(RenderSettings, render_values(), "params.yaml")
    path = tmp_path / "settings.json"
    path.write_text(to_json(settings))
    assert read_stage_file(path, RenderSettings, "") == settings
    assert settings.scene.instruments == (1, 2)


@pytest.mark.parametrize("values", [None, 3, "all"])
def test_a_part_that_is_no_mapping_is_named(values: Any) -> None:
    # `loss:` without anything below it is None in YAML.
    assert "params.yaml: part" in complaint(LossSettings, values)


def test_nested_values_become_flat_and_sequences_stay_whole() -> None:
    nested = {"loss": {"alpha": 1.5, "beta": [1, 2]}, "seed": 7}
    assert flatten(nested) == {"loss.alpha": 1.5, "loss.beta": [1, 2], "seed": 7}
