"""A finished training is not repeated, so that an interrupted sweep resumes."""

import inspect
import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import mlflow
import pytest
import torch

from pipelines import train as stage
from shaftpose.settings.tree import Settings
from shaftpose.training import run
from tests.pipeline.conftest import ROOT, run_here, settings_with
from tests.pipeline.test_resume import kill_when

SCRIPT = str(ROOT / "pipelines/train.py")
SIZES = (
    "profile=smoke", "profiles.smoke.steps=1", "variant.start=null", "trainer=cpu",
    "profiles.smoke.warmup_steps=0", "profiles.smoke.batch_size=2", "training.loader_workers=0",
)  # fmt: skip
SWEEP = ("hydra.sweep.dir=sweeps/mine", "loss.alpha=0.5,2.0")
SEARCH = ("hydra/sweeper=optuna", "hydra.sweep.dir=sweeps/search", "loss.alpha=interval(0.5,2.0)")


def run_stage(settings: Settings) -> dict[str, Any]:
    """Run the stage in this process; return its `training.json`."""
    inspect.unwrap(stage.main)(settings)  # without Hydra
    record: dict[str, Any] = json.loads((settings.out / "training.json").read_text())
    return record


@pytest.fixture
def settings(inside: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Settings:
    """The settings of a training of one step."""
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    return settings_with(*SIZES, f"out={tmp_path}")


def test_a_finished_training_is_not_repeated(
    settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = run_stage(settings)
    with monkeypatch.context() as patch:
        patch.setattr(run, "fit", None)
        assert run_stage(settings) == first


def test_a_training_that_another_process_finishes_meanwhile_is_not_repeated(
    settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = run_stage(settings)
    answers = iter([False, True])  # before and after the wait for the lock
    with monkeypatch.context() as patch:
        patch.setattr(run, "is_finished", lambda folder: next(answers))
        patch.setattr(run, "fit", None)
        assert run_stage(settings) == first


def test_other_loss_weights_train_again(settings: Settings, tmp_path: Path) -> None:
    first = run_stage(settings)
    second = run_stage(settings_with(*SIZES, f"out={tmp_path}", "loss.alpha=0.25"))
    assert (first["variant"]["loss"]["alpha"], second["variant"]["loss"]["alpha"]) == (1.5, 0.25)
    assert second["fingerprint"] != first["fingerprint"]
    assert second["training_id"] != first["training_id"]


def test_a_finished_training_takes_the_new_values_of_settings_that_it_does_not_read(
    settings: Settings, tmp_path: Path
) -> None:
    first = run_stage(settings)
    second = run_stage(replace(settings, size=replace(settings.size, test_set=3)))
    assert second["recipe"]["size"]["test_set"] == 3 != first["recipe"]["size"]["test_set"]
    assert second["training_id"] == first["training_id"]


def test_earlier_settings_find_their_result_again(settings: Settings, tmp_path: Path) -> None:
    """Even if DVC has removed the files in `out`."""
    first = run_stage(settings)
    checkpoint = (tmp_path / "model.ckpt").read_bytes()
    run_stage(replace(settings, seed=settings.seed + 1))
    assert (tmp_path / "model.ckpt").read_bytes() != checkpoint
    (tmp_path / "model.ckpt").unlink()
    assert run_stage(settings) == first
    assert (tmp_path / "model.ckpt").read_bytes() == checkpoint


@pytest.mark.parametrize("lost", ["model.ckpt", "curves.csv", "training.json"])
def test_half_a_result_is_none(tmp_path: Path, lost: str) -> None:
    for name in ("model.ckpt", "curves.csv", "training.json"):
        torch.save({}, tmp_path / name)
    assert run.is_finished(tmp_path)
    (tmp_path / lost).unlink()
    assert not run.is_finished(tmp_path)


def test_a_damaged_result_is_none(tmp_path: Path) -> None:
    for name in ("model.ckpt", "curves.csv", "training.json"):
        torch.save({}, tmp_path / name)
    data = bytearray((tmp_path / "model.ckpt").read_bytes())
    data[data.index(b"}")] ^= 1  # an empty dictionary, pickled
    (tmp_path / "model.ckpt").write_bytes(data)
    assert not run.is_finished(tmp_path)


def test_an_interrupted_training_leaves_no_result_of_another(
    settings: Settings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_stage(settings)

    def interrupted(*args: Any) -> None:
        raise KeyboardInterrupt

    changed = replace(settings, seed=settings.seed + 2)
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(run, "fit", interrupted)
        run_stage(changed)
    assert not (tmp_path / "training.json").exists()


def start_sweep(project: Path, *overrides: str) -> subprocess.Popen[str]:
    environment = os.environ | {"PYTHONPATH": str(ROOT / "src")}
    environment.pop("MLFLOW_TRACKING_URI", None)
    return subprocess.Popen(
        [sys.executable, SCRIPT, "-m", *SIZES, *overrides],
        cwd=project, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip


def test_an_interrupted_sweep_goes_on(inside: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first = kill_when(start_sweep(inside, *SWEEP), "sweeps/mine/0/training.json", inside)
    first_id = json.loads(first.read_text())["training_id"]
    run_here(SCRIPT, "-m", *SIZES, *SWEEP)
    assert capsys.readouterr().out.count(": finished; its result is in") == 1
    assert json.loads(first.read_text())["training_id"] == first_id
    assert (inside / "sweeps/mine/1/training.json").is_file()
    mlflow.set_tracking_uri(f"sqlite:///{inside / 'mlflow.db'}")
    runs = mlflow.search_runs(experiment_names=["shaftpose mine"], output_format="list")
    (parent,) = [run.info.run_id for run in runs if "shaftpose.sweep" in run.data.tags]
    nested = [run for run in runs if run.data.tags.get("mlflow.parentRunId") == parent]
    assert sorted(run.data.params["loss.alpha"] for run in nested) == ["0.5", "2.0"]


def test_a_search_that_is_started_again_repeats_no_job(
    inside: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for trials in (1, 2):
        run_here(SCRIPT, "-m", *SIZES, *SEARCH, f"hydra.sweeper.trials={trials}")
        assert capsys.readouterr().out.count(": finished; its result is in") == trials - 1
    records = [(inside / f"sweeps/search/{job}/training.json").read_text() for job in range(2)]
    first, second = (json.loads(record)["variant"]["loss"]["alpha"] for record in records)
    assert 0.5 <= first != second <= 2.0
