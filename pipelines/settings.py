"""From the composed configuration to the package's checked settings."""

from collections.abc import Mapping
from typing import Any

from shaftpose.config import (
    BackgroundSettings,
    ClusterSettings,
    DetectionSettings,
    LossSettings,
    RenderSettings,
    RunSettings,
    Size,
    SplitSettings,
    TrainingSettings,
    parse,
)

Config = dict[str, Any]


def check(config: Config) -> None:
    """Parse every part, whatever the stage: a wrong loss weight shall not wait for the render.

    Raises InputError naming the first wrong key.
    """
    size(config)
    cluster_settings(config)
    render_settings(config)
    stand_in = config["real"]["stand_in"]
    render_settings(config, scene=stand_in["scene"], lens=stand_in["lens"])
    parts = {
        "backgrounds": BackgroundSettings,
        "split": SplitSettings,
        "loss": LossSettings,
        "training": TrainingSettings,
        "detection": DetectionSettings,
    }
    for name, kind in parts.items():
        parse(kind, config[name], f"params.yaml: {name}")
    run = {
        "seed": config["seed"],
        "champion_margin": config["report"]["champion_margin"],
    }
    parse(RunSettings, run, "params.yaml")


def size(config: Config) -> Size:
    """The sizes of the chosen profile."""
    return parse(Size, config["size"], f"conf/profiles.yaml: {config['profile']}")


def cluster_settings(config: Config) -> ClusterSettings:
    """Who renders."""
    return parse(ClusterSettings, config["cluster"], "params.yaml: cluster")


def render_settings(config: Config, **changed: Mapping[str, Any]) -> RenderSettings:
    """How images are rendered; `scene=` or `lens=` replace single settings of these parts."""
    parts = {
        name: {**config[name], **changed.get(name, {})}
        for name in ("camera", "poses", "shaft", "scene", "lens")
    }
    values = {
        **parts,
        "samples": config["size"]["samples"],
        "jpeg_quality": config["render"]["jpeg_quality"],
    }
    return parse(RenderSettings, values, "params.yaml")
