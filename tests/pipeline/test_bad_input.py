"""What a user may get wrong ends in one line that names it, and status 1."""

from pathlib import Path

import pytest

from tests.pipeline.conftest import Run


def complaint(run: Run, *command: str) -> str:
    """The last line of a stage that must fail without a traceback."""
    result = run("python", *command)
    assert result.returncode == 1, result.stdout
    assert "Traceback" not in result.stderr
    return result.stderr.strip().splitlines()[-1]


@pytest.mark.parametrize(
    ("override", "named"),
    [
        ("profile=huge", "profile = 'huge'"),
        ("profiles.smoke.images=-3", "images = -3"),
        ("poses.x_mm=[20,-20]", "poses.x_mm"),
        ("poses.z_mm=deep", "poses.z_mm = 'deep'"),
        ("scene.instruments=[2,1]", "scene.instruments"),
        ("seed=-1", "seed = -1"),
        ("real.stand_in.lens.haze=[0,2]", "lens.haze"),
    ],
)
def test_render_settings(run: Run, tmp_path: Path, override: str, named: str) -> None:
    line = complaint(run, "pipelines/backgrounds.py", f"out={tmp_path}", override)
    assert line.startswith("error: ")
    assert named in line


def test_beta_of_the_wrong_length(run: Run, tmp_path: Path) -> None:
    line = complaint(run, "pipelines/train.py", f"out={tmp_path}", "loss.beta=[1,1,2]")
    assert "loss.beta" in line


def test_unknown_variant_is_named_with_the_known_ones(run: Run, tmp_path: Path) -> None:
    result = run("python", "pipelines/train.py", "variant=z", f"out={tmp_path}")
    assert result.returncode == 1
    assert "variant/z" in result.stderr
    assert "d_noise_real" in result.stderr


def test_empty_background_folder(run: Run, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    line = complaint(
        run,
        "pipelines/backgrounds.py",
        f"out={tmp_path / 'out'}",
        f"backgrounds.source={tmp_path / 'empty'}",
    )
    assert str(tmp_path / "empty") in line


def test_a_wrong_loss_weight_does_not_wait_for_the_render(run: Run, tmp_path: Path) -> None:
    line = complaint(run, "pipelines/backgrounds.py", f"out={tmp_path}", "loss.alpha=-1")
    assert line.startswith("error: params.yaml: loss.alpha = -1")
