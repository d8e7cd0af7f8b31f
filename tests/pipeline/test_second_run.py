"""A stage refuses to write to a folder that another run writes to, whatever their settings."""

from pathlib import Path

import pytest

from shaftpose.farm.locks import alone_in
from tests.pipeline.conftest import Run


@pytest.mark.parametrize("script", ["render.py", "real_images.py"])
def test_a_stage_is_refused_while_another_run_has_its_folder(
    run: Run, clone: Path, tmp_path: Path, script: str
) -> None:
    out = tmp_path / "written"
    with alone_in(out, tmp_path / "data/scratch"):
        command = ("python", str(clone / "pipelines" / script), f"out={out}", "seed=8")
        done = run("env", f"--chdir={tmp_path}", *command)
    assert done.returncode == 1
    assert done.stderr.strip() == (
        f"error: {out}: another run is writing to this folder; wait for it to end"
    )
    assert not out.exists()
