"""A training is packed, run as on another machine, and taken back."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import mlflow
import pytest
import torch

from shaftpose.core.errors import InputError
from shaftpose.network.building import trained_network
from shaftpose.training.assembly import build_module
from shaftpose.training.fingerprint import data_record
from tests.pipeline.conftest import recipe_with, settings_with
from tests.pipeline.small_data import FOLDERS, write_training_data
from tools.pack_training import main, pack
from tools.unpack_training import track, unpack

PIECE = 100_000
DETECTOR = Path("models/detector/model.ckpt")
SIZES = (
    "profile=smoke", "profiles.smoke.steps=2", "profiles.smoke.warmup_steps=0", "trainer=cpu",
    "profiles.smoke.batch_size=2", "training.loader_workers=0", "training.images_in_memory=true",
    "variant=d_noise_real",
)  # fmt: skip


@pytest.fixture
def project(store: Path) -> Path:
    """A working directory with data, a detector and an MLflow database."""
    write_training_data(store)
    module = build_module(recipe_with("profile=smoke", "variant=detector"))
    state = {f"network.{name}": value for name, value in module.network.state_dict().items()}
    DETECTOR.parent.mkdir(parents=True)
    torch.save({"state_dict": state, "identity": module.identity}, DETECTOR)
    return store


def run_there(pieces: Path, out: Path) -> str:
    """What the packed script prints, in an environment without this project."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    environment["PATH"] = f"{Path(sys.executable).parent}:{environment['PATH']}"
    done = subprocess.run(
        ["sh", str(pieces / "train_packed.sh"), str(out)],
        cwd=pieces.parent, env=environment, capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stderr


def test_a_packed_training_comes_back(project: Path) -> None:
    there, result, out = project / "there/pack", project / "there/result", project / "back/d"
    pack(settings_with(*SIZES), there, wheels=None, most_bytes=PIECE)
    sizes = [path.stat().st_size for path in there.glob("pack.tar.gz.*")]
    assert len(sizes) > 1 and max(sizes) == PIECE
    assert "training D + noise + real: 2 steps of 2 images" in run_there(there, result)
    assert "training D + noise + real: finished" in run_there(there, result)
    pack(settings_with(*SIZES, "seed=8"), there, wheels=None, most_bytes=PIECE)
    with pytest.raises(AssertionError, match="error: .*/pack/run is of other pieces than"):
        run_there(there, result)
    unpack(result, out)
    record = json.loads((out / "training.json").read_text())
    assert record["data"] == asdict(data_record(FOLDERS, mixed_in=True, start=DETECTOR))
    variant = recipe_with(*SIZES).variant
    trained = torch.load(there / "run/result/model.ckpt", weights_only=True)["state_dict"]
    for name, value in trained_network(variant, out / "model.ckpt").state_dict().items():
        assert torch.equal(value, trained[f"network.{name}"]), name
    track(result, out)
    (run,) = mlflow.search_runs(experiment_names=["trials"], output_format="list")
    assert run.info.run_name == "d_noise_real"
    assert run.data.tags["shaftpose.training"] == record["training_id"]
    assert run.data.tags["dataset.digest"] == record["data"]["digest"]
    assert run.data.params["size.steps"] == "2"
    curves = (out / "curves.csv").read_text()
    for name in ("train/loss", "validation/mAP"):
        assert f"1,{name},{run.data.metrics[name]}" in curves


@pytest.mark.parametrize(
    ("option", "says"),
    [("--piece-mib=0", "--piece-mib 0: give a number above 0"),
     ("--wheels=none", "--wheels none: no folder; name one with wheels")],
)  # fmt: skip
def test_a_wrong_option_is_named(
    option: str, says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["pack_training", str(tmp_path), option])
    with pytest.raises(SystemExit, match=says):
        main()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda: Path("data/split/train.csv").unlink(), "^data/split/train.csv: missing; run the"),
        (DETECTOR.unlink, f"^{DETECTOR}: no such checkpoint"),
    ],
)
def test_missing_data_are_named(project: Path, change: Callable[[], None], says: str) -> None:
    change()
    with pytest.raises(InputError, match=says):
        pack(settings_with(*SIZES), project / "pack", wheels=None, most_bytes=PIECE)


def test_a_detector_of_another_size_is_refused(project: Path) -> None:
    with pytest.raises(InputError, match="holds a network of"):
        wider = settings_with(*SIZES, "profiles.smoke.width=0.25")
        pack(wider, project / "pack", wheels=None, most_bytes=PIECE)
