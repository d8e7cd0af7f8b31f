"""A training whose result is there is not repeated: a sweep that was interrupted goes on."""

import inspect
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import mlflow
import pytest

from tests.pipeline.conftest import ROOT
from tests.pipeline.test_configs import composed
from tests.pipeline.test_resume import kill_when

sys.path.insert(0, str(ROOT / "pipelines"))

import train  # noqa: E402
from stage import Config  # noqa: E402

SIZES = (
    "profile=smoke", "profiles.smoke.steps=1", "variant.start=null", "trainer=cpu",
    "profiles.smoke.warmup_steps=0", "profiles.smoke.batch_size=2", "training.loader_workers=0",
)  # fmt: skip
SWEEP = ("-m", "hydra.sweep.dir=sweeps/mine", "loss.alpha=0.5,2.0", *SIZES)


def run_stage(config: Config) -> dict[str, Any]:
    """Run the stage in this process; returns what it notes of the training."""
    inspect.unwrap(train.main)(config)  # without Hydra
    facts: dict[str, Any] = json.loads((Path(config["out"]) / "training.json").read_text())
    return facts


@pytest.fixture
def config(inside: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Config:
    """A training of one step."""
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    return composed(*SIZES, f"out={tmp_path}")


def test_a_finished_training_is_not_repeated(config: Config, tmp_path: Path) -> None:
    first = run_stage(config)
    checkpoint = (tmp_path / "model.ckpt").stat()
    assert run_stage(config) == first
    assert (tmp_path / "model.ckpt").stat() == checkpoint


def test_other_loss_weights_train_anew(config: Config, tmp_path: Path) -> None:
    first = run_stage(config)
    config["loss"]["alpha"] = 0.25
    second = run_stage(config)
    assert second["recipe"]["loss"] == config["loss"] != first["recipe"]["loss"]
    assert second["fingerprint"] != first["fingerprint"]
    assert second["training_id"] != first["training_id"]


@pytest.mark.parametrize("lost", ["model.ckpt", "curves.csv", "training.json"])
def test_half_a_result_is_none(tmp_path: Path, lost: str) -> None:
    for name in ("model.ckpt", "curves.csv"):
        (tmp_path / name).touch()
    (tmp_path / "training.json").write_text('{"fingerprint": "abc"}')
    assert train.is_finished(tmp_path, "abc")
    assert not train.is_finished(tmp_path, "abd")
    (tmp_path / lost).unlink()
    assert not train.is_finished(tmp_path, "abc")


def test_an_interrupted_training_leaves_no_result_of_another(
    config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = run_stage(config)

    def interrupted(*args: Any) -> None:
        raise KeyboardInterrupt

    changed = {**config, "seed": config["seed"] + 1}
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(train, "fit", interrupted)
        run_stage(changed)
    assert not train.is_finished(tmp_path, first["fingerprint"])


def start_sweep(project: Path) -> subprocess.Popen[str]:
    environment = os.environ | {"PYTHONPATH": str(ROOT / "src")}
    environment.pop("MLFLOW_TRACKING_URI", None)
    return subprocess.Popen(
        [sys.executable, str(ROOT / "pipelines/train.py"), *SWEEP],
        cwd=project, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip


def test_an_interrupted_sweep_goes_on(inside: Path) -> None:
    first = kill_when(start_sweep(inside), "sweeps/mine/0/training.json", inside)
    written_at = first.stat().st_mtime_ns
    process = start_sweep(inside)
    output, _ = process.communicate()
    assert process.returncode == 0, output
    assert output.count(": finished; its result is in") == 1
    assert first.stat().st_mtime_ns == written_at
    assert (inside / "sweeps/mine/1/training.json").is_file()
    mlflow.set_tracking_uri(f"sqlite:///{inside / 'mlflow.db'}")
    runs = mlflow.search_runs(experiment_names=["shaftpose"], output_format="list")
    (parent,) = [run.info.run_id for run in runs if "shaftpose.sweep" in run.data.tags]
    nested = [run for run in runs if run.data.tags.get("mlflow.parentRunId") == parent]
    assert sorted(run.data.params["loss.alpha"] for run in nested) == ["0.5", "2.0"]
