"""All settings of a run as one frozen tree, parsed and checked once from Hydra's composition."""

import logging
import re
from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import yaml
from pydantic import ConfigDict, Field, TypeAdapter
from pydantic.dataclasses import dataclass

from shaftpose.core.errors import InputError
from shaftpose.settings.parsing import first_complaint, parse
from shaftpose.settings.schema import (
    BackgroundSettings,
    CameraSettings,
    ClusterSettings,
    DetectionSettings,
    LensSettings,
    LossSettings,
    PoseRanges,
    RealSettings,
    RenderOptions,
    RenderSettings,
    ReportSettings,
    RunSize,
    SceneSettings,
    ShaftSettings,
    SplitSettings,
    TrackingSettings,
    TrainerSettings,
    TrainingSettings,
    Variant,
)

VARIANTS = Path("conf/variant")  # in the project's folder
BACKBONE_SIDE_PX = 299  # of the paper's images; its maps have fixed sizes


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class Settings:
    """All settings, by their names in params.yaml and conf/config.yaml."""

    profile: str
    preset: str
    seed: Annotated[int, Field(ge=0, lt=2**31)]
    variants: Annotated[tuple[str, ...], Field(min_length=1)]
    camera: CameraSettings
    poses: PoseRanges
    shaft: ShaftSettings
    backgrounds: BackgroundSettings
    scene: SceneSettings
    lens: LensSettings
    render: RenderOptions
    cluster: ClusterSettings
    split: SplitSettings
    real: RealSettings
    loss: LossSettings
    training: TrainingSettings
    detection: DetectionSettings
    report: ReportSettings
    tracking: TrackingSettings
    size: RunSize
    trainer: TrainerSettings
    variant: Variant
    overrides: tuple[str, ...]
    out: Path
    results: Path
    model_folder: Path

    @cached_property
    def rendering(self) -> RenderSettings:
        """Settings of the rendered images. Raises ValidationError if they do not go together."""
        return RenderSettings(
            camera=self.camera, poses=self.poses, shaft=self.shaft, scene=self.scene,
            lens=self.lens, samples=self.size.samples, **vars(self.render),
        )  # fmt: skip

    @cached_property
    def stand_in(self) -> RenderSettings:
        """Settings of the rendered stand-in for real images."""
        look = self.real.stand_in
        scene, lens = replace(self.scene, **vars(look.scene)), replace(self.lens, **vars(look.lens))
        return replace(self.rendering, scene=scene, lens=lens)


def read_settings(composed: Mapping[str, Any], root: Path) -> Settings:
    """Parse the settings composed by Hydra. root: the project's folder.

    Every stage checks all settings, so that a wrong loss weight fails before the render.
    Raises InputError naming the first wrong key.
    """
    variant, profile, preset = (composed[name] for name in ("variant", "profile", "preset"))
    elsewhere = {
        "size": parse(RunSize, composed["size"], f"conf/profiles.yaml: {profile}."),
        "trainer": parse(TrainerSettings, composed["trainer"], "trainer."),
        "variant": parse(Variant, variant, f"conf/variant/{variant['name']}.yaml: "),
    }
    where = "params.yaml: " if preset == "none" else f"params.yaml or conf/preset/{preset}.yaml: "
    with first_complaint(where):
        settings = TypeAdapter(Settings).validate_python({**composed, **elsewhere})
        settings.rendering, settings.stand_in  # noqa: B018  # checks that their parts go together
    check_symmetries(settings.variant, settings.poses)
    check_loss_weights(settings, root)
    if settings.detection.refine == "views" and not settings.poses.symmetric:
        raise InputError(
            "params.yaml: detection.refine = views: mirrored and turned shafts leave "
            f"{_ranges(settings.poses)}, or refine by other means (none, mask, edges)"
        )
    check_variants(settings, root)
    return settings


def check_loss_weights(settings: Settings, root: Path) -> None:
    """Raise InputError if the command line sets a weight that the variant does not read, so that a
    sweep would compare equal trainings."""
    file = f"{VARIANTS}/{settings.variant.name}.yaml"
    for override in settings.overrides:
        name = override.partition("=")[0].lstrip("+")
        if name.partition(".")[0] != "loss":
            continue
        text = re.sub(r"#.*", "", (root / file).read_text())
        read = [f"{one}." for one in re.findall(r"\$\{(loss\b[\w.]*)\}", text)]
        if not any(f"{name}.".startswith(one) or one.startswith(f"{name}.") for one in read):
            raise InputError(
                f"{override}: {file} does not read {name}, so nothing would change; set a weight "
                "of its own `loss`, as in variant.loss.mask=1 for E"
            )


def check_symmetries(variant: Variant, ranges: PoseRanges) -> None:
    """Raise InputError if a variant's mirrored and rotated images would show poses outside the
    ranges."""
    if variant.symmetries and not ranges.symmetric:
        raise InputError(
            f"conf/variant/{variant.name}.yaml: symmetries = True: mirrored and turned shafts "
            f"leave {_ranges(ranges)}, set symmetries to false (in conf/profiles.yaml; of E, in "
            "its file), or do not train the variant (params.yaml: variants)"
        )


def _ranges(ranges: PoseRanges) -> str:
    return (
        f"poses.x_mm = {ranges.x_mm}, y_mm = {ranges.y_mm} or yaw_deg = {ranges.yaw_deg}; make x "
        "and y the same range around 0 and yaw a full turn from 0"
    )


def check_image_size(variant: Variant, camera: CameraSettings) -> None:
    """Raise InputError if a variant cannot read images of the camera's size."""
    if "backbone" in variant.network and camera.size_px != BACKBONE_SIDE_PX:
        raise InputError(
            f"conf/variant/{variant.name}.yaml: its backbone reads images of {BACKBONE_SIDE_PX} "
            f"px, but params.yaml: camera.size_px = {camera.size_px}; set {BACKBONE_SIDE_PX}, or "
            "do not train the variant (params.yaml: variants)"
        )


def check_variants(settings: Settings, root: Path) -> None:
    """Check the files of the variants that the ablation compares.

    Raises InputError if one learns no poses, cannot read the images or cannot be mirrored, or if
    two have the same name or title.
    """
    named: dict[str, str] = {}
    for name in settings.variants:
        chosen = read_variant(name, root, settings.size)
        if not chosen.pose_loss:
            raise InputError(
                f"params.yaml: variants: {name!r}: learns no poses (its pose_loss is false); "
                "remove it from the list: it is a detector for other variants to start from"
            )
        check_image_size(chosen, settings.camera)
        check_symmetries(chosen, settings.poses)
        title = chosen.title
        if named.get(title) == name:
            raise InputError(f"params.yaml: variants: {name!r}: listed twice; remove one")
        if title in named:
            raise InputError(
                f"conf/variant/{name}.yaml: title = {title!r}: conf/variant/{named[title]}.yaml "
                "has the same; give each variant its own title"
            )
        named[title] = name


def warn_of_unread_images(settings: Settings, root: Path) -> None:
    """Warn if no variant that the ablation compares learns from the user's real images."""
    variants = [read_variant(name, root, settings.size) for name in settings.variants]
    if settings.real.source and not any(variant.real_share for variant in variants):
        logging.getLogger(__name__).warning(
            "no variant of params.yaml learns from the images of real.source: add e_real or "
            "d_noise_real, or set `real_share` in a variant's file"
        )


def read_yaml(path: Path, where: str, remedy: str) -> dict[str, Any]:
    """Read a file of settings. Raises InputError, which begins with `where`, if it holds none."""
    try:
        values = yaml.safe_load(path.read_text())
    except (yaml.YAMLError, OSError, UnicodeDecodeError) as error:
        raise InputError(f"{where}no YAML: {' '.join(str(error).split())}; {remedy}") from error
    if not isinstance(values, dict):
        raise InputError(f"{where}holds no settings; {remedy}")
    return values


def read_variant(name: str, root: Path, size: RunSize) -> Variant:
    """Read the variant of a name, whose network and loss still refer to other settings.

    size: what its other values may refer to. Raises InputError if its file is missing or holds no
    settings, or a value is wrong.
    """
    path = root / VARIANTS / f"{name}.yaml"
    if not path.is_file():
        known = ", ".join(sorted(found.stem for found in path.parent.glob("*.yaml")))
        raise InputError(f"params.yaml: variants: {name!r}: unknown; choose from {known}")
    where = f"conf/variant/{name}.yaml: "
    values = read_yaml(path, where, "copy conf/variant/d.yaml and change it")
    if "name" in values:
        raise InputError(f"{where}name = {values['name']!r}: remove it, the file's name is used")
    sizes = {f"${{size.{key}}}": value for key, value in vars(size).items()}
    plain = {key: sizes[value] for key, value in values.items() if value in [*sizes]}
    return parse(Variant, {**values, **plain, "name": name}, where)
