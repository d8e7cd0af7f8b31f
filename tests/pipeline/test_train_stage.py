"""The stage `train`: its script, and functions that it calls."""

import json
import os
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import mlflow
import pytest
import torch
from torch import nn

from shaftpose.core.errors import InputError
from shaftpose.core.shard_index import shard_paths
from shaftpose.dataset.split import read_keys
from shaftpose.network.ssd.single_shot import SingleShotNetwork
from shaftpose.sweeps import summary
from shaftpose.training.assembly import build_module, build_trainer
from shaftpose.training.curves import Curves
from shaftpose.training.fingerprint import data_record
from shaftpose.training.recipe import native_precision
from tests.pipeline.conftest import ROOT, recipe_with, run_here
from tests.pipeline.small_data import FOLDERS, write_training_data

SCRIPT, OUT = str(ROOT / "pipelines/train.py"), ("out=models/d",)
SIZES = (
    "profile=smoke", "profiles.smoke.steps=2", "variant.start=null",
    "profiles.smoke.warmup_steps=0", "profiles.smoke.batch_size=4", "training.loader_workers=0",
)  # fmt: skip
CPU = ("trainer=cpu",)
# torch does not synchronise batch normalisation between processes on a CPU.
TWO_PROCESSES = (
    "trainer=ddp", "trainer.accelerator=cpu", "trainer.devices=2", "trainer.sync_batchnorm=false",
)  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder in which the stage runs."""
    write_training_data(tmp_path)
    return tmp_path


def run_stage(folder: Path, *overrides: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": str(ROOT / "src")}
    environment.pop("MLFLOW_TRACKING_URI", None)
    return subprocess.run(
        [sys.executable, SCRIPT, *OUT, *SIZES, *overrides],
        cwd=folder, env=environment, capture_output=True, text=True, timeout=300,
    )  # fmt: skip


def facts(folder: Path) -> dict[str, Any]:
    noted: dict[str, Any] = json.loads((folder / "models/d/training.json").read_text())
    return noted


def damage(folder: Path, key: str) -> None:
    """Overwrite the JPEG of an image in its shard."""
    for path in shard_paths(folder / "data/render/images"):
        content = path.read_bytes()
        name = content.find(f"{key}.rgb.jpg".encode())
        if name >= 0:  # tar: a header of 512 bytes, then the file
            path.write_bytes(content[: name + 512] + bytes(256) + content[name + 768 :])
            return
    raise AssertionError(f"{key} is in no shard")


def test_two_processes_share_a_training(folder: Path) -> None:
    done = run_stage(folder, *TWO_PROCESSES, "training.ema_decay=0.5", "training.max_hours=1",
                     "training.checkpoint_minutes=0")  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert facts(folder)["steps"] == 2
    checkpoint = torch.load(folder / "models/d/model.ckpt", weights_only=True)
    assert all(torch.isfinite(value).all() for value in checkpoint["state_dict"].values())
    assert "validation/mAP" in (folder / "models/d/curves.csv").read_text()
    mlflow.set_tracking_uri(f"sqlite:///{folder / 'mlflow.db'}")
    (run,) = mlflow.search_runs(experiment_names=["shaftpose"], output_format="list")
    assert run.info.status == "FINISHED"


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which a training has replaced an earlier result that was like a file in DVC's
    cache: read-only, with a second hard link, `cached`."""
    folder = tmp_path_factory.mktemp("trained")
    write_training_data(folder)
    cached, result = folder / "cached", folder / "models/d/model.ckpt"
    cached.write_bytes(b"of another training")
    result.parent.mkdir(parents=True)
    result.hardlink_to(cached)
    cached.chmod(0o444)
    sizes = ("profiles.smoke.steps=1", "profiles.smoke.precision=auto")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        run_here(SCRIPT, *OUT, *SIZES, *CPU, *sizes, "variant=d_noise_real")
    return folder


def test_the_precision_of_the_device_is_noted(trained: Path) -> None:
    assert facts(trained)["recipe"]["size"]["precision"] == native_precision("cpu")


def test_what_a_training_was_on_is_noted(trained: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    noted = facts(trained)
    monkeypatch.chdir(trained)
    assert noted["data"] == asdict(data_record(FOLDERS, mixed_in=True, start=None))
    assert (noted["data"]["mixed_in"]["domain"], noted["data"]["mixed_in"]["images"]) == ("real", 2)
    assert noted["variant"] == recipe_with(*SIZES, "variant=d_noise_real").variant_key()
    assert noted["data"]["start"] is None
    mlflow.set_tracking_uri(f"sqlite:///{trained / 'mlflow.db'}")
    (run,) = mlflow.search_runs(experiment_names=["shaftpose"], output_format="list")
    assert run.data.tags["dataset.digest"] == noted["data"]["digest"]
    assert run.data.tags["dataset.real_digest"] == noted["data"]["mixed_in"]["digest"]


def test_a_result_that_may_not_be_written_to_is_replaced(trained: Path) -> None:
    assert (trained / "cached").read_bytes() == b"of another training"
    assert "state_dict" in torch.load(trained / "models/d/model.ckpt", weights_only=True)


def test_a_job_that_fails_does_not_keep_others_of_its_sweep(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    sweep = ("hydra.sweep.dir=sweeps/mine", "loss.alpha=-1,1.5", "-m")
    with pytest.raises(SystemExit) as ended:
        run_here(SCRIPT, *SIZES, *CPU, *sweep)
    assert ended.value.code == "error: failed jobs: sweeps/mine/0/error.txt"
    printed = "".join(capsys.readouterr())
    assert "error: params.yaml: loss.alpha = -1" in printed
    assert Path("sweeps/mine/0/error.txt").read_text().startswith("error: params.yaml: loss.alpha")
    assert Path("sweeps/mine/1/model.ckpt").is_file()
    assert "page: " in printed
    monkeypatch.setattr(summary, "summarise", Mock(side_effect=InputError("no server")))
    with pytest.raises(SystemExit, match=r"failed jobs: sweeps/mine/0/error\.txt$"):
        run_here(SCRIPT, *SIZES, *CPU, *sweep)
    assert Path("sweeps/mine/sweep.html").is_file()


def test_a_damaged_image_stops_the_stage_unless_it_may_be_skipped(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    key = read_keys(folder / "data/split", "train")[0]
    damage(folder, key)
    stopped = run_stage(folder, *CPU, "training.loader_workers=1")
    assert stopped.returncode == 1
    last = stopped.stderr.splitlines()[-1]
    assert last.startswith("error: data/render/images/") and f"image {key} is damaged" in last
    assert not (folder / "models/d/model.ckpt").exists()
    monkeypatch.chdir(folder)
    run_here(SCRIPT, *OUT, *SIZES, *CPU, "training.on_damaged=skip")
    assert facts(folder)["skipped_images"] == 1


def test_the_loss_is_weighed_as_the_settings_say() -> None:
    weights = ("loss.alpha=0.25", "loss.gamma=7", "loss.beta=[1,2,3,4,6]")
    network = build_module(recipe_with(*SIZES, *weights)).network
    assert isinstance(network, SingleShotNetwork)
    loss = network.loss
    assert (loss.alpha, loss.gamma, loss.beta.tolist()) == (0.25, 7.0, [1, 2, 3, 4, 6])


def test_the_trainer_has_the_precision_and_the_clipping_of_the_settings(tmp_path: Path) -> None:
    recipe = recipe_with(
        *SIZES, *CPU, "training.gradient_clip=0.5", "profiles.smoke.precision=bf16-mixed"
    )
    trainer = build_trainer(recipe, tmp_path, Curves())
    assert (trainer.precision, trainer.gradient_clip_val) == ("bf16-mixed", 0.5)


@pytest.mark.parametrize(
    "accelerator",
    [
        pytest.param(
            "gpu", marks=pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
        ),
        "abacus",
    ],
)
def test_a_trainer_that_cannot_be_had_is_named(accelerator: str, tmp_path: Path) -> None:
    recipe = recipe_with(*SIZES, *CPU, f"trainer.accelerator={accelerator}")
    with pytest.raises(InputError, match="see conf/trainer$") as raised:
        build_trainer(recipe, tmp_path, Curves())
    assert str(raised.value).startswith(f"trainer = {{'accelerator': '{accelerator}'")
    assert "\n" not in str(raised.value)


def test_the_network_is_compiled_if_the_settings_say_so(monkeypatch: pytest.MonkeyPatch) -> None:
    compiled: list[nn.Module] = []
    monkeypatch.setattr(nn.Module, "compile", lambda network: compiled.append(network))
    for wanted in ("false", "true"):
        module = build_module(recipe_with(*SIZES, f"training.compile={wanted}"))
    assert compiled == [module.network]
