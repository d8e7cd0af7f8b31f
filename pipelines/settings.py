"""From the composed configuration to the package's checked settings."""

from collections.abc import Mapping
from typing import Any

from stage import Config

from shaftpose.config import RenderSettings, Size, parse


def size(config: Config) -> Size:
    """The sizes of the chosen profile."""
    return parse(Size, config["size"], f"conf/profiles.yaml: {config['profile']}")


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
