"""Every combination of configuration files composes and builds what it names."""

import inspect
import sys
from pathlib import Path

import pytest
import yaml
from hydra import compose, initialize_config_dir
from hydra.core.hydra_config import HydraConfig
from lightning import Trainer
from omegaconf import OmegaConf

from shaftpose.config import Variant
from shaftpose.errors import InputError
from shaftpose.network.pose_bins import BinCoder
from tests.pipeline.conftest import Run

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "pipelines"))

import networks  # noqa: E402
import settings  # noqa: E402
from stage import Config  # noqa: E402

VARIANTS = sorted(path.stem for path in (ROOT / "conf/variant").glob("*.yaml"))
PROFILES = sorted(yaml.safe_load((ROOT / "conf/profiles.yaml").read_text()))


def composed(*overrides: str) -> Config:
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        config = compose("config", ["out=here", *overrides], return_hydra_config=True)
        HydraConfig.instance().set_config(config)
        OmegaConf.set_struct(config, False)
        del config["hydra"]
    values = OmegaConf.to_container(config, resolve=True)
    assert isinstance(values, dict)
    return {str(key): value for key, value in values.items()}


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("profile", PROFILES)
def test_variants_and_profiles_compose(variant: str, profile: str) -> None:
    config = composed(f"variant={variant}", f"profile={profile}")
    assert networks.variant(config).name == variant
    assert settings.size(config).steps > settings.size(config).warmup_steps
    assert settings.size(config).steps >= settings.size(config).validate_every
    assert settings.render_settings(config).samples == config["size"]["samples"]


@pytest.mark.parametrize(
    ("override", "says"),
    [
        ("render.device=gpu", "params.yaml: render.device = 'gpu': "),
        ("render.jpeg_quality=0", "params.yaml: render.jpeg_quality = 0: "),
        ("scene.roughness=[0,2]", "params.yaml: scene.roughness = "),
        ("real.stand_in.scene.roughness=[0,2]", "params.yaml: real.stand_in.scene.roughness = "),
        ("~real.stand_in.lens", "params.yaml: real.stand_in.lens is missing; add it"),
        ("+tracking.url=http://127.0.0.1", "params.yaml: tracking.url = 'http://127.0.0.1': "),
        ("report.champion_margin=-1", "params.yaml: report.champion_margin = -1: "),
        ("variants=d_noise", "params.yaml.variants = 'd_noise': "),
        ("variants=[]", "params.yaml.variants = []: "),
        ("variants=[c,d,c]", "params.yaml: variants: 'c': listed twice"),
        ("variants=[c,detector]", "params.yaml: variants: 'detector': learns no poses"),
        ("profiles.smoke.depth=0.1", "conf/profiles.yaml: smoke: depth = 0.1 gives the three"),
        ("profiles.smoke.width=0.1", "conf/profiles.yaml: smoke: width = 0.1 gives the first"),
    ],
)
def test_a_wrong_value_is_named_as_params_has_it(override: str, says: str) -> None:
    with pytest.raises(InputError) as caught:
        settings.check(composed("profile=smoke", override))
    assert str(caught.value).startswith(says)


@pytest.mark.parametrize(
    ("ranges", "allowed"),
    [
        ("poses.z_mm=[5,20]", True),
        ("poses.x_mm=[-10,20]", False),
        ("poses.y_mm=[-10,10]", False),
        ("poses.yaw_deg=[0,180]", False),
        ("poses.yaw_deg=[-180,180]", False),
    ],
)
def test_symmetries_need_symmetric_ranges(ranges: str, allowed: bool) -> None:
    mirrored = "training.augmentation.symmetries=true"
    settings.check(composed("profile=smoke", ranges))
    if allowed:
        settings.check(composed("profile=smoke", ranges, mirrored))
    else:
        with pytest.raises(InputError, match=r"symmetries = True: .* leave poses"):
            settings.check(composed("profile=smoke", ranges, mirrored))


@pytest.mark.parametrize("variant", VARIANTS)
def test_networks_are_built_at_the_width_of_the_profile(variant: str) -> None:
    network = networks.build_network(composed(f"variant={variant}", "profile=smoke"))
    assert network.backbone.width == 0.1875


@pytest.mark.parametrize(("variant", "values"), [("b", 40 + 40 + 30 + 8 + 72), ("c", 5), ("d", 5)])
def test_poses_are_coded_as_the_variant_says(variant: str, values: int) -> None:
    network = networks.build_network(composed(f"variant={variant}", "profile=smoke"))
    assert network.pose_coder.values == values


def test_classes_follow_the_steps_and_the_ranges() -> None:
    steps, ranges = "variant.pose_coder.steps=[2,2,2,10,10]", "poses.z_mm=[10,20]"
    network = networks.build_network(composed("variant=b", "profile=smoke", steps, ranges))
    assert isinstance(network.pose_coder, BinCoder)
    assert network.pose_coder.bins == (20, 20, 5, 4, 36)


def test_variants_with_one_title_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    alike = Variant(name="mine", title="D", start=None, pose_loss=True, noise=0, real_share=0.0)
    monkeypatch.setattr(settings, "read_variant", lambda _: alike)
    with pytest.raises(InputError, match=r"^conf/variant/mine\.yaml: title = 'D': .*/d\.yaml has"):
        settings.check_variants(["d", "mine"])


def test_a_variant_that_is_not_called_as_its_file_is_named() -> None:
    config = composed("variant=b", "profile=smoke", "variant.name=d")
    with pytest.raises(InputError, match="conf/variant/b.yaml: name = 'd': must be the file's"):
        networks.variant(config)


@pytest.mark.parametrize("part", ["head", "pose_coder"])
def test_a_variant_without_a_part_is_named(part: str) -> None:
    config = composed("variant=b", "profile=smoke")
    del config["variant"][part]
    with pytest.raises(InputError, match=f"conf/variant/b.yaml: {part} is missing"):
        networks.variant(config)


@pytest.mark.parametrize(
    ("trainer", "accelerator", "devices"),
    [("auto", "auto", 1), ("cpu", "cpu", 1), ("gpu", "gpu", 1), ("ddp", "gpu", "auto")],
)
def test_trainers_compose(trainer: str, accelerator: str, devices: int | str) -> None:
    chosen = composed(f"trainer={trainer}")["trainer"]
    assert (chosen["accelerator"], chosen["devices"]) == (accelerator, devices)
    assert chosen.keys() <= inspect.signature(Trainer).parameters.keys()


def test_the_slurm_trainer_takes_its_size_from_the_job(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SLURM_NNODES", "3")
    monkeypatch.setenv("SLURM_NTASKS_PER_NODE", "4")
    chosen = composed("trainer=slurm")["trainer"]
    assert (chosen["num_nodes"], chosen["devices"], chosen["strategy"]) == (3, 4, "ddp")
    assert chosen.keys() <= inspect.signature(Trainer).parameters.keys()


def test_folders_of_the_project_are_no_config_groups(run: Run, clone: Path) -> None:
    """Hydra takes `out=here` for the choice of a file, where it finds a folder `out`."""
    folders = [clone / name for name in ("out", "results", "variants")]
    for folder in folders:
        folder.mkdir()
    command = ("pipelines/split.py", "out=here", "results=there", "variants=[c]", "--cfg", "job")
    result = run("python", *command)
    for folder in folders:
        folder.rmdir()
    assert result.returncode == 0, result.stderr
    shown = yaml.safe_load(result.stdout)
    assert (shown["out"], shown["results"], shown["variants"]) == ("here", "there", ["c"])


@pytest.mark.parametrize("launcher", ["workstation", "slurm"])
def test_launchers_compose(launcher: str) -> None:
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        config = compose("config", [f"hydra/launcher={launcher}"], return_hydra_config=True)
    expected = {"workstation": "joblib", "slurm": "submitit"}[launcher]
    assert expected in config.hydra.launcher._target_.lower()


def test_real_share_is_two_to_nine() -> None:
    assert networks.variant(composed("variant=d_noise_real")).real_share == pytest.approx(2 / 11)
