"""All settings of a run as one frozen tree, parsed and checked once from Hydra's composition."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import yaml
from pydantic import Field
from pydantic.dataclasses import dataclass

from shaftpose.core.errors import InputError
from shaftpose.settings.parsing import as_mapping, parse
from shaftpose.settings.scaling import block_counts, check_width
from shaftpose.settings.schema import (
    BackgroundSettings,
    CameraSettings,
    ClusterSettings,
    DetectionSettings,
    LossSettings,
    PoseRanges,
    RenderSettings,
    ReportSettings,
    Size,
    SplitSettings,
    TrackingSettings,
    TrainerSettings,
    TrainingSettings,
    Variant,
)

VARIANTS = Path("conf/variant")  # in the project's folder
BACKBONE_SIDE_PX = 299  # of the paper's images; its maps have fixed sizes
_RENDERING = ("camera", "poses", "shaft", "scene", "lens")


@dataclass(frozen=True)
class Settings:
    """All settings of conf/ and params.yaml, and the paths that a stage reads and writes.

    rendering: of the training images; stand_in: of the stand-in for real images; real_source: the
    user's folder of real images, None for the stand-in. params.yaml explains the rest.
    """

    profile: str
    seed: Annotated[int, Field(ge=0, lt=2**31)]
    variants: Annotated[tuple[str, ...], Field(min_length=1)]
    size: Size
    backgrounds: BackgroundSettings
    rendering: RenderSettings
    stand_in: RenderSettings
    real_source: Path | None
    cluster: ClusterSettings
    split: SplitSettings
    loss: LossSettings
    training: TrainingSettings
    trainer: TrainerSettings
    variant: Variant
    detection: DetectionSettings
    report: ReportSettings
    tracking: TrackingSettings
    out: Path
    results: Path
    model_folder: Path


# Parts that are parsed unchanged, by name.
_PARTS: dict[str, type] = {
    "backgrounds": BackgroundSettings,
    "cluster": ClusterSettings,
    "split": SplitSettings,
    "loss": LossSettings,
    "training": TrainingSettings,
    "detection": DetectionSettings,
    "report": ReportSettings,
    "tracking": TrackingSettings,
}
# All keys of the top level: of params.yaml, and of conf/config.yaml.
_KEYS = {
    *_PARTS, *_RENDERING, "render", "real", "profile", "preset", "seed", "variants", "profiles",
    "size", "trainer", "variant", "variant_file", "out", "results", "model_folder",
}  # fmt: skip


def read_settings(composed: Mapping[str, Any], root: Path) -> Settings:
    """Parse the settings composed by Hydra. root: the project's folder.

    Every stage checks all settings, so that a wrong loss weight fails before the render.
    Raises InputError naming the first wrong key.
    """
    _check_keys(composed)
    size = read_size(composed)
    real = _keys(composed["real"], {"source", "stand_in"}, "params.yaml: real")
    stand_in = _keys(real["stand_in"], {"scene", "lens"}, "params.yaml: real.stand_in")
    parts: dict[str, object] = {
        name: parse(kind, composed[name], f"params.yaml: {name}") for name, kind in _PARTS.items()
    }
    settings = parse(
        Settings,
        {
            **parts,
            "size": size,
            "rendering": _rendering(composed, size.samples),
            "stand_in": _rendering(composed, size.samples, "params.yaml: real.stand_in.", stand_in),
            "real_source": real["source"],
            "trainer": parse(TrainerSettings, composed["trainer"], "trainer"),
            "variant": parse_variant(composed["variant"], composed["variant_file"]),
            **{
                name: composed[name]
                for name in ("profile", "seed", "variants", "out", "results", "model_folder")
            },
        },
        "params.yaml",
    )
    check_symmetries(settings.variant, settings.rendering.poses)
    check_variants(settings, root)
    return settings


def read_size(composed: Mapping[str, Any]) -> Size:
    """The sizes of the chosen profile. Raises InputError naming the profile if one is wrong."""
    where = f"conf/profiles.yaml: {composed['profile']}"
    size = parse(Size, composed["size"], where)
    try:
        check_width(size.width)
        block_counts(size.depth)
    except InputError as error:
        raise InputError(f"{where}: {error}") from error
    return size


def _rendering(
    composed: Mapping[str, Any],
    samples: int,
    where: str = "params.yaml: ",
    changed: Mapping[str, Mapping[str, Any]] | None = None,
) -> RenderSettings:
    """The render settings; `changed` replaces single settings of scene and lens.

    where: the prefix of a part's name in messages.
    """
    kinds, changed = get_type_hints(RenderSettings), changed or {}
    parts: dict[str, object] = {}
    for name in _RENDERING:
        own = as_mapping(composed[name], f"params.yaml: {name}")
        changes = as_mapping(changed.get(name, {}), f"{where}{name}")
        parts[name] = parse(kinds[name], {**own, **changes}, f"{where}{name}")
    render = as_mapping(composed["render"], "params.yaml: render")
    return parse(RenderSettings, {**parts, **render, "samples": samples}, "params.yaml: render")


def _check_keys(composed: Mapping[str, Any]) -> None:
    """Raise InputError naming an unknown or a missing key of the top level."""
    for name in sorted(composed.keys() - _KEYS):
        raise InputError(f"params.yaml: {name}: unknown; remove it, or indent it into its section")
    for name in sorted(_KEYS - composed.keys()):
        raise InputError(f"params.yaml: {name} is missing; add it")


def _keys(values: object, expected: set[str], where: str) -> Mapping[str, Any]:
    if not isinstance(values, Mapping) or values.keys() != expected:
        raise InputError(f"{where} = {values!r}: must have the keys {', '.join(sorted(expected))}")
    return values


def check_symmetries(variant: Variant, ranges: PoseRanges) -> None:
    """Raise InputError if a variant's mirrored and rotated images would show poses outside the
    ranges."""
    (low, high), (first, last) = ranges.x_mm, ranges.yaw_deg
    symmetric = ranges.x_mm == ranges.y_mm and low == -high and first == 0 and last > 350
    if variant.symmetries and not symmetric:
        raise InputError(
            f"conf/variant/{variant.name}.yaml: symmetries = True: mirrored and rotated "
            f"shafts leave poses.x_mm = {ranges.x_mm}, y_mm = {ranges.y_mm} or yaw_deg = "
            f"{ranges.yaw_deg}; make x and y the same range around 0 and yaw a full turn from 0, "
            "set symmetries to false, or do not train the variant (params.yaml: variants)"
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
        chosen = read_variant(name, root)
        if not chosen.pose_loss:
            raise InputError(
                f"params.yaml: variants: {name!r}: learns no poses (its pose_loss is false); "
                "remove it from the list: it is a detector for other variants to start from"
            )
        check_image_size(chosen, settings.rendering.camera)
        check_symmetries(chosen, settings.rendering.poses)
        title = chosen.title
        if named.get(title) == name:
            raise InputError(f"params.yaml: variants: {name!r}: listed twice; remove one")
        if title in named:
            raise InputError(
                f"conf/variant/{name}.yaml: title = {title!r}: conf/variant/{named[title]}.yaml "
                "has the same; give each variant its own title"
            )
        named[title] = name


def read_variant(name: str, root: Path) -> Variant:
    """Read the variant of a name. Raises InputError if its file is missing or a value is wrong."""
    path = root / VARIANTS / f"{name}.yaml"
    if not path.is_file():
        known = ", ".join(sorted(found.stem for found in path.parent.glob("*.yaml")))
        raise InputError(f"params.yaml: variants: {name!r}: unknown; choose from {known}")
    return parse_variant(yaml.safe_load(path.read_text()), name)


def parse_variant(values: Mapping[str, Any], name: str) -> Variant:
    """Parse the values of conf/variant/`name`.yaml.

    Raises InputError if a key is missing or a value is wrong.
    """
    where = f"conf/variant/{name}.yaml"
    if "name" in values:
        raise InputError(f"{where}: name = {values['name']!r}: remove it, the file's name is used")
    return parse(Variant, {**values, "name": name}, where)
