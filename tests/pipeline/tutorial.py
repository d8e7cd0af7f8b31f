"""The commands and settings of docs/tutorial.md, and files as it asks for."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from shaftpose.core.images import write_jpeg
from tests.pipeline.conftest import ROOT

TUTORIAL = (ROOT / "docs/tutorial.md").read_text()
# An angle of 2 atan(360 / 500) across the central square.
CALIBRATION = """%YAML:1.0
---
image_width: 1280
image_height: 720
camera_matrix: {rows: 3, cols: 3, dt: d, data: [500, 0, 639.5, 0, 500, 359.5, 0, 0, 1]}
distortion_coefficients: {rows: 5, cols: 1, dt: d, data: [0, 0, 0, 0, 0]}
"""


def blocks(language: str) -> list[str]:
    """The tutorial's blocks of code in a language."""
    return re.findall(rf"```{language}\n(.*?)```", TUTORIAL, re.DOTALL)


def merged(old: Any, new: Any) -> Any:
    """Values with those of `new` in place of their own."""
    if not isinstance(new, dict):
        return new
    assert new.keys() <= old.keys(), f"params.yaml lacks one of {list(new)}"
    return old | {key: merged(old[key], value) for key, value in new.items()}


def write_own_files(folder: Path) -> None:
    """The calibration, images of tissue and a frame that the tutorial asks for."""
    rng = np.random.default_rng(0)
    for n in range(12):
        coarse = rng.integers(60, 200, (9, 16, 3), dtype=np.uint8)
        write_jpeg(coarse.repeat(80, axis=0).repeat(80, axis=1), folder / f"tissue/{n}.jpg")
    write_jpeg(np.full((720, 1280, 3), 120, np.uint8), folder / "frames/frame.jpg")
    (folder / "cam.yaml").write_text(CALIBRATION)


def change_settings(params: Path, **others: Any) -> None:
    """Change params.yaml as the tutorial says, and then a few settings more."""
    (changed,) = blocks("yaml")
    values = merged(yaml.safe_load(params.read_text()), yaml.safe_load(changed)) | others
    params.write_text(yaml.dump(values, default_flow_style=None, sort_keys=False))
