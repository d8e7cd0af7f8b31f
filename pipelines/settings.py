"""From the composed configuration to the package's checked settings."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, get_type_hints

import yaml

from shaftpose.config import (
    BackgroundSettings,
    ClusterSettings,
    DetectionSettings,
    LossSettings,
    PoseRanges,
    RealSettings,
    RenderSettings,
    ReportSettings,
    RunSettings,
    Size,
    SplitSettings,
    TrackingSettings,
    TrainingSettings,
    Variant,
    parse,
)
from shaftpose.errors import InputError
from shaftpose.network.scaling import block_counts, check_width

_BUILT = ("head", "pose_coder")  # what of a variant's file names classes

Config = dict[str, Any]


def check(config: Config) -> None:
    """Parse every part, whatever the stage: a wrong loss weight shall not wait for the render.

    Raises InputError naming the first wrong key.
    """
    check_network_size(config)
    cluster_settings(config)
    render_settings(config)
    stand_in = parse(RealSettings, config["real"], "params.yaml: real").stand_in
    where = "params.yaml: real.stand_in."
    render_settings(config, where, scene=stand_in.scene, lens=stand_in.lens)
    parts = {
        "backgrounds": BackgroundSettings,
        "split": SplitSettings,
        "loss": LossSettings,
        "training": TrainingSettings,
        "detection": DetectionSettings,
        "report": ReportSettings,
        "tracking": TrackingSettings,
    }
    for name, kind in parts.items():
        parse(kind, config[name], f"params.yaml: {name}")
    check_symmetries(config)
    run = {"seed": config["seed"], "variants": config["variants"]}
    check_variants(parse(RunSettings, run, "params.yaml").variants)


def check_network_size(config: Config) -> None:
    """Raise InputError naming the profile if no network has its width and depth."""
    sizes = size(config)
    try:
        check_width(sizes.width)
        block_counts(sizes.depth)
    except InputError as error:
        raise InputError(f"conf/profiles.yaml: {config['profile']}: {error}") from error


def check_symmetries(config: Config) -> None:
    """Raise InputError if mirrored and turned images would show poses beyond `poses`."""
    ranges = parse(PoseRanges, config["poses"], "params.yaml: poses")
    (low, high), (first, last) = ranges.x_mm, ranges.yaw_deg
    symmetric = ranges.x_mm == ranges.y_mm and low == -high and first == 0 and last > 350
    training = parse(TrainingSettings, config["training"], "params.yaml: training")
    if training.augmentation.symmetries and not symmetric:
        raise InputError(
            "params.yaml: training.augmentation.symmetries = True: mirrored and turned shafts "
            f"leave poses.x_mm = {ranges.x_mm}, y_mm = {ranges.y_mm} or yaw_deg = "
            f"{ranges.yaw_deg}; make x and y the same range around 0 and yaw a full turn from 0, "
            "or set it to false"
        )


def check_variants(names: Sequence[str]) -> None:
    """Parse the files of variants.

    Raises InputError if one learns no poses, or two cannot be told apart in the report.
    """
    named: dict[str, str] = {}
    for name in names:
        chosen = read_variant(name)
        if not chosen.pose_loss:
            raise InputError(
                f"params.yaml: variants: {name!r}: learns no poses (its pose_loss is false); "
                "remove it, other variants start from it"
            )
        title = chosen.title
        if named.get(title) == name:
            raise InputError(f"params.yaml: variants: {name!r}: listed twice; remove one")
        if title in named:
            raise InputError(
                f"conf/variant/{name}.yaml: title = {title!r}: conf/variant/{named[title]}.yaml "
                "has it, too; give each variant its own"
            )
        named[title] = name


def read_variant(name: str) -> Variant:
    """What distinguishes the variant of a name.

    Raises InputError if there is no such file or a value is wrong.
    """
    path = Path(__file__).parents[1] / f"conf/variant/{name}.yaml"
    if not path.is_file():
        known = ", ".join(sorted(found.stem for found in path.parent.glob("*.yaml")))
        raise InputError(f"params.yaml: variants: {name!r}: unknown; choose from {known}")
    return parse_variant(yaml.safe_load(path.read_text()), name)


def parse_variant(values: Mapping[str, Any], file: str) -> Variant:
    """What distinguishes the variant of conf/variant/`file`.yaml, but for what Hydra builds.

    Raises InputError if a part is missing, a value is wrong, or its name is not the file's.
    """
    where = f"conf/variant/{file}.yaml"
    for part in _BUILT:
        if part not in values:
            raise InputError(f"{where}: {part} is missing; take it over from another variant")
    chosen = parse(Variant, {k: v for k, v in values.items() if k not in _BUILT}, where)
    if chosen.name != file:
        raise InputError(
            f"{where}: name = {chosen.name!r}: must be the file's name, for outputs bear it"
        )
    return chosen


def size(config: Config) -> Size:
    """The sizes of the chosen profile."""
    return parse(Size, config["size"], f"conf/profiles.yaml: {config['profile']}")


def cluster_settings(config: Config) -> ClusterSettings:
    """Who renders."""
    return parse(ClusterSettings, config["cluster"], "params.yaml: cluster")


def render_settings(
    config: Config, where: str = "params.yaml: ", **changed: Mapping[str, Any]
) -> RenderSettings:
    """How images are rendered; `scene=` or `lens=` replace single settings of these parts.

    where: what comes before a part's name in messages.
    """
    kinds = get_type_hints(RenderSettings)
    parts = {
        name: parse(kinds[name], {**config[name], **changed.get(name, {})}, f"{where}{name}")
        for name in ("camera", "poses", "shaft", "scene", "lens")
    }
    values = {
        **parts,
        "samples": config["size"]["samples"],
        "jpeg_quality": config["render"]["jpeg_quality"],
        "device": config["render"]["device"],
    }
    return parse(RenderSettings, values, "params.yaml: render")
