"""The commands of docs/tutorial.md, on small images."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from shaftpose.core.images import write_jpeg
from tests.pipeline.conftest import ROOT, Run, commit, copy_tracked

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


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """A clone with a user's files and settings."""
    copy_tracked(ROOT, tmp_path)
    (tmp_path / "dvc.lock").unlink(missing_ok=True)
    write_own_files(tmp_path / "mine")
    params = tmp_path / "params.yaml"
    (changed,) = blocks("yaml")
    params.write_text(yaml.dump(merged(yaml.safe_load(params.read_text()), yaml.safe_load(changed)),
                                default_flow_style=None))  # fmt: skip
    commit(tmp_path)
    return tmp_path


def test_the_commands_run_and_their_files_are_there(own: Path, run: Run) -> None:
    printed = ""
    for block in blocks("bash"):
        done = run("env", f"--chdir={own}", f"PYTHONPATH={own / 'src'}", "bash", "-ec", block)
        assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
        printed += done.stdout
    assert "set camera.view_deg to 71.5" in printed
    for name in ("look.jpg", "backgrounds.jpg", "reports/e/figures/predictions.jpg"):
        assert (own / name).stat().st_size > 10_000
    rows = json.loads((own / "reports/ablation.json").read_text())["rows"]
    assert [(row["variant"], row["refined"]) for row in rows] == [("e", False), ("e", True)]
    assert all(row["silhouettes"] for row in rows)
    assert {(row["test_images"], row["steps"]) for row in rows} == {(6, 6)}
    assert "| E + fit |" in (own / "reports/ablation.md").read_text()
    assert (own / "found/predictions.jsonl").read_text().count("\n") == 1
