"""Every combination of configuration files composes and builds its network."""

import inspect
import re
from dataclasses import asdict, replace
from pathlib import Path

import pytest
import yaml
from hydra import compose, initialize_config_dir
from lightning import Trainer

from shaftpose.core.errors import InputError
from shaftpose.network.building import build_network
from shaftpose.network.dense.network import DenseNetwork
from shaftpose.network.ssd.pose_bins import BinCoder
from shaftpose.network.ssd.single_shot import SingleShotNetwork
from shaftpose.settings.tree import Settings, check_variants, warn_of_unread_images
from shaftpose.stage_files import DataRecord
from shaftpose.training.fingerprint import fingerprint
from tests.pipeline.conftest import ROOT, Run, recipe_with, settings_with

VARIANTS = sorted(path.stem for path in (ROOT / "conf/variant").glob("*.yaml"))
PROFILES = sorted(yaml.safe_load((ROOT / "conf/profiles.yaml").read_text()))


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("profile", PROFILES)
def test_variants_and_profiles_compose(variant: str, profile: str) -> None:
    settings = settings_with(f"variant={variant}", f"profile={profile}")
    assert settings.variant.name == variant
    assert settings.size.steps > settings.size.warmup_steps
    assert settings.size.steps >= settings.size.validate_every
    assert settings.rendering.samples == settings.size.samples


def test_numbers_are_the_same_however_they_are_written() -> None:
    """`alpha: 1` and `alpha: 1.0` give the same training."""
    one, same = (recipe_with("profile=smoke", f"loss.alpha={alpha}") for alpha in ("1", "1.0"))
    data = DataRecord(start=None, training_images=1, digest="", mixed_in=None)
    assert fingerprint(one, data) == fingerprint(same, data)


@pytest.mark.parametrize(
    ("override", "says"),
    [
        ("render.device=gpu", "params.yaml: render.device = 'gpu': "),
        ("render.jpeg_quality=0", "params.yaml: render.jpeg_quality = 0: "),
        ("scene.roughness=[0,2]", "params.yaml: scene.roughness.1 = 2: "),
        ("real.stand_in.lens.haze=[0,2]", "params.yaml: real.stand_in.lens.haze.1 = 2: "),
        ("~real.stand_in.lens", "params.yaml: real.stand_in.lens is missing; add it"),
        ("~training.compile", "params.yaml: training.compile is missing; add it"),
        ("~report", "params.yaml: report is missing; add it"),
        ("+colour=1", "params.yaml: colour = 1: unknown; remove it, or move it into its section"),
        ("scene.jaws_probability=1 shaft.tip=forceps", "params.yaml: scene.jaws_probability = 1: "),
        (
            "preset=laparoscopy scene.films=[0,2]",
            "params.yaml or conf/preset/laparoscopy.yaml: scene.films.1 = 2: ",
        ),
        ("shaft.length_mm=1 shaft.tip=forceps", "params.yaml: shaft: length_mm = 1 must be more"),
        ("variant.noise=-1", "conf/variant/d.yaml: noise = -1: "),
        ("+tracking.url=http://127.0.0.1", "params.yaml: tracking.url = 'http://127.0.0.1': "),
        ("report.champion_margin=-1", "params.yaml: report.champion_margin = -1: "),
        ("camera.size_px=30", "params.yaml: camera.size_px = 30: "),
        ("variants=d_noise", "params.yaml: variants = 'd_noise': "),
        ("variants=[]", "params.yaml: variants = []: "),
        ("variants=[c,d,c]", "params.yaml: variants: 'c': listed twice"),
        ("variants=[c,detector]", "params.yaml: variants: 'detector': learns no poses"),
        ("profiles.smoke.depth=0.1", "conf/profiles.yaml: smoke.depth = 0.1: "),
        ("profiles.smoke.width=0.1", "conf/profiles.yaml: smoke.width = 0.1: "),
    ],
)
def test_a_wrong_value_is_named_as_params_has_it(override: str, says: str) -> None:
    with pytest.raises(InputError) as caught:
        settings_with("profile=smoke", *override.split())
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
    """Of the stage's own variant, of all that will be trained, and of views in predictions."""
    plain = ("profile=smoke", ranges, "variants=[d]", "profiles.smoke.symmetries=false")
    settings_with(*plain)
    for mirrored in (
        "profiles.smoke.symmetries=true", "variants=[d,e]", "detection.refine=views"
    ):  # fmt: skip
        if allowed:
            settings_with(*plain, mirrored)
        else:
            with pytest.raises(InputError, match=r"(s = True|refine = views): .* leave poses"):
                settings_with(*plain, mirrored)


def network(*overrides: str) -> SingleShotNetwork:
    built = build_network(recipe_with("profile=smoke", *overrides).variant)
    assert isinstance(built, SingleShotNetwork)
    return built


@pytest.mark.parametrize("variant", [name for name in VARIANTS if name not in ("e", "e_real")])
def test_the_papers_networks_are_built_at_the_width_of_the_profile(variant: str) -> None:
    assert network(f"variant={variant}").backbone.width == 0.1875


def test_a_network_of_another_kind_is_built_as_its_file_says() -> None:
    network = build_network(recipe_with("profile=smoke", "variant=e").variant)
    assert isinstance(network, DenseNetwork)
    assert [stage[0][0].out_channels for stage in network.down] == [16, 32, 48, 64, 96, 128]  # type: ignore[index,union-attr]


@pytest.mark.parametrize(("variant", "values"), [("b", 40 + 40 + 30 + 8 + 72), ("c", 5), ("d", 5)])
def test_poses_are_coded_as_the_variant_says(variant: str, values: int) -> None:
    assert network(f"variant={variant}").pose_coder.values == values


def test_classes_follow_the_steps_and_the_ranges() -> None:
    steps, ranges = "variant.network.pose_coder.steps=[2,2,2,10,10]", "poses.z_mm=[10,20]"
    coder = network("variant=b", steps, ranges).pose_coder
    assert isinstance(coder, BinCoder)
    assert coder.bins == (20, 20, 5, 4, 36)


def variant_file(folder: Path, file: str, source: str, **changed: object) -> None:
    """A variant's file in `folder`, copied from another one; keys that are None are left out."""
    content = yaml.safe_load((ROOT / f"conf/variant/{source}.yaml").read_text()) | changed
    path = folder / f"conf/variant/{file}.yaml"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(yaml.safe_dump({k: v for k, v in content.items() if v is not None}))


def settings_of(*variants: str) -> Settings:
    return replace(settings_with("profile=smoke"), variants=variants)


def test_variants_with_one_title_are_refused(tmp_path: Path) -> None:
    variant_file(tmp_path, "d", "d")
    variant_file(tmp_path, "mine", "d")
    with pytest.raises(InputError, match=r"^conf/variant/mine\.yaml: title = 'D': .*/d\.yaml has"):
        check_variants(settings_of("d", "mine"), tmp_path)


@pytest.mark.parametrize(
    ("variants", "source", "warned"),
    [("e", "mine", True), ("e,d_noise_real", "mine", False), ("e", "null", False)],
)
def test_real_images_that_no_variant_learns_from_are_warned_of(
    variants: str, source: str, warned: bool, caplog: pytest.LogCaptureFixture
) -> None:
    warn_of_unread_images(settings_with(f"variants=[{variants}]", f"real.source={source}"), ROOT)
    assert ("no variant of params.yaml learns from" in caplog.text) is warned


@pytest.mark.parametrize(
    "override", ["loss.alpha=2.0", "++loss.gamma=2.0", "loss.beta.0=2.0", "loss={alpha: 2.0}"]
)
def test_a_weight_that_a_variant_does_not_read_is_refused(override: str) -> None:
    settings_with("variant=d", override)
    with pytest.raises(InputError, match=f"^{re.escape(override)}: conf/variant/e.yaml does not"):
        settings_with("variant=e", override)
    settings_with("variant=e", "variant.loss.mask=2.0")


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"name": "d"}, "name = 'd': remove it, the file's name is used"),
        ({"network": None}, "network is missing; add it"),
        ({"network": {"head": "D"}}, "must name a class or function as _target_"),
        (
            {"loss": {"_target_": "shaftpose.x", "terms": {"_target_": "mine.Loss"}}},
            "_target_ mine.Loss is outside of shaftpose",
        ),
    ],
)
def test_a_variants_file_is_checked(changed: dict[str, object], says: str, tmp_path: Path) -> None:
    variant_file(tmp_path, "mine", "b", **changed)
    with pytest.raises(InputError, match=f"^conf/variant/mine.yaml.*{says}"):
        check_variants(settings_of("mine"), tmp_path)


@pytest.mark.parametrize(
    ("text", "says"),
    [("", "holds no settings; copy"), ("title: [D", "no YAML: .* line 1")],
)
def test_a_variants_file_without_settings_is_named(text: str, says: str, tmp_path: Path) -> None:
    variant_file(tmp_path, "mine", "b")
    (tmp_path / "conf/variant/mine.yaml").write_text(text)
    with pytest.raises(InputError, match=f"^conf/variant/mine.yaml: {says}"):
        check_variants(settings_of("mine"), tmp_path)


@pytest.mark.parametrize(
    ("trainer", "accelerator", "devices"),
    [("auto", "auto", 1), ("cpu", "cpu", 1), ("gpu", "gpu", 1), ("ddp", "gpu", "auto")],
)
def test_trainers_compose(trainer: str, accelerator: str, devices: int | str) -> None:
    chosen = settings_with(f"trainer={trainer}").trainer
    assert (chosen.accelerator, chosen.devices) == (accelerator, devices)
    assert asdict(chosen).keys() <= inspect.signature(Trainer).parameters.keys()


def test_the_slurm_trainer_takes_its_size_from_the_job(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SLURM_NNODES", "3")
    monkeypatch.setenv("SLURM_NTASKS_PER_NODE", "4")
    chosen = settings_with("trainer=slurm").trainer
    assert (chosen.num_nodes, chosen.devices, chosen.strategy) == (3, 4, "ddp")
    assert asdict(chosen).keys() <= inspect.signature(Trainer).parameters.keys()


def test_folders_of_the_project_are_no_config_groups(run: Run, clone: Path) -> None:
    """Hydra reads `out=here` as a group choice if it finds a folder `out` in its search path."""
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


def test_a_backbone_reads_images_of_the_papers_size_alone() -> None:
    says = r"^conf/variant/\w+\.yaml: its backbone reads images of 299 px, .*size_px = 320; set 299"
    with pytest.raises(InputError, match=says):
        settings_with("camera.size_px=320")
    for_e = ("camera.size_px=320", "variants=[e]")
    with pytest.raises(InputError, match=says):
        recipe_with(*for_e, "variant=d")
    assert build_network(recipe_with(*for_e, "variant=e").variant).side_px == 320


@pytest.mark.parametrize(
    ("override", "says"),
    [
        ("variant.loss.smooth=-1", "smooth"),
        ("+variant.loss.sooth=1", "sooth"),
        ("variant.network.channels=[0]", "channels"),
        ("~variant.network.shaft", "shaft"),
    ],
)
def test_a_wrong_argument_of_a_network_is_named(override: str, says: str) -> None:
    with pytest.raises(InputError, match=rf"^conf/variant/e\.yaml: .*{says}"):
        build_network(settings_with("variant=e", override).variant)


def test_real_share_is_two_to_nine() -> None:
    assert settings_with("variant=d_noise_real").variant.real_share == pytest.approx(2 / 11)


def test_hydra_reads_the_file_that_dvc_watches() -> None:
    assert (ROOT / "conf/params.yaml").readlink() == Path("../params.yaml")
