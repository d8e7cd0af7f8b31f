"""A killed training resumes and ends bit for bit like an undisturbed one."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import mlflow
import pytest
import torch
from lightning import Callback, Trainer, seed_everything
from torch import Tensor

from shaftpose.dataset.training_stream import SkippedImages
from shaftpose.evaluation.model_results import read_curves
from shaftpose.training.assembly import build_module, build_trainer
from shaftpose.training.curves import Curves
from shaftpose.training.data import training_data
from shaftpose.training.run import fit
from tests.pipeline.conftest import ROOT, recipe_with
from tests.pipeline.small_data import FOLDERS

STEPS, LOG_EVERY = 5, 2
SIZES = (
    "profile=smoke", f"profiles.smoke.steps={STEPS}", "variant.start=null", "trainer=cpu",
    "profiles.smoke.validate_every=3", "profiles.smoke.batch_size=2", "training.loader_workers=0",
    "variant=d_noise_real",
)  # fmt: skip
SELDOM, ALWAYS = "training.checkpoint_minutes=60", "training.checkpoint_minutes=0"
OPTIONS = ("training.ema_decay=0.5", "training.gradient_clip=1.0", "variant=c")


class Killed(Exception):
    pass


STEP, VALIDATION = "the step after", "the validation after"
Death = tuple[str, int]  # when it strikes, and after how many steps


class Watched(Callback):
    """Draws a random number from torch before each step, and raises `Killed` at its death."""

    def __init__(self, death: Death | None) -> None:
        self.death = death
        self.drawn: dict[int, float] = {}

    def on_train_batch_start(self, trainer: Trainer, *args: Any) -> None:
        self.drawn[trainer.global_step] = torch.rand(()).item()

    def on_before_zero_grad(self, trainer: Trainer, *args: Any) -> None:
        self.die_if_due(STEP, trainer)

    def on_validation_batch_end(self, trainer: Trainer, *args: Any) -> None:
        self.die_if_due(VALIDATION, trainer)

    def die_if_due(self, what: str, trainer: Trainer) -> None:
        if self.death == (what, trainer.global_step):
            raise Killed


class Training:
    """A training, run until it ends or is killed."""

    def __init__(
        self, folder: Path, overrides: tuple[str, ...], death: Death | None = None
    ) -> None:
        recipe = recipe_with(*SIZES, *overrides)
        self.curves, self.watched = Curves(), Watched(death)
        seed_everything(recipe.seed, verbose=False)
        self.trainer = build_trainer(recipe, folder, self.curves)
        self.trainer.callbacks.insert(0, self.watched)
        self.trainer.log_every_n_steps = LOG_EVERY
        self.module = build_module(recipe)
        data = training_data(recipe, FOLDERS, SkippedImages(folder / "skipped.txt"))
        folder.mkdir(exist_ok=True)
        fit(self.trainer, self.module, data, folder)

    @property
    def weights(self) -> dict[str, Tensor]:
        return self.module.network.state_dict()


@pytest.fixture(scope="module")
def undisturbed(project: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Training]:
    """Trainings without an interruption, by kind."""
    found = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(project)
        for name, overrides in {"plain": (SELDOM,), "options": (SELDOM, *OPTIONS)}.items():
            found[name] = Training(tmp_path_factory.mktemp(name), overrides)
    return found


def assert_same(resumed: Training, expected: Training) -> None:
    assert resumed.trainer.global_step == expected.trainer.global_step == STEPS
    for name, value in expected.weights.items():
        assert torch.equal(resumed.weights[name], value), name
    assert resumed.curves.rows == expected.curves.rows
    assert resumed.watched.drawn.items() <= expected.watched.drawn.items()


@pytest.mark.parametrize(
    ("checkpoints", "death", "goes_on_at"),
    [
        (SELDOM, (STEP, 4), 3),
        (ALWAYS, (STEP, 2), 1),  # no checkpoint is written at step 2, which logs
        (ALWAYS, (VALIDATION, 3), 1),
        (ALWAYS, (VALIDATION, 5), 3),  # the last one
    ],
)
def test_a_killed_training_ends_like_an_undisturbed_one(
    inside: Path,
    undisturbed: dict[str, Training],
    tmp_path: Path,
    checkpoints: str,
    death: Death,
    goes_on_at: int,
) -> None:
    with pytest.raises(Killed):
        Training(tmp_path, (checkpoints,), death)
    resumed = Training(tmp_path, (checkpoints,))
    assert min(resumed.watched.drawn) == goes_on_at
    assert_same(resumed, undisturbed["plain"])


def test_a_training_may_be_killed_again_and_again(
    inside: Path, undisturbed: dict[str, Training], tmp_path: Path
) -> None:
    for dies_after in (0, 1, 3, 4):
        with pytest.raises(Killed):
            Training(tmp_path, (ALWAYS,), (STEP, dies_after))
    assert_same(Training(tmp_path, (ALWAYS,)), undisturbed["plain"])


def test_averaged_and_clipped_weights_are_kept_too(
    inside: Path, undisturbed: dict[str, Training], tmp_path: Path
) -> None:
    with pytest.raises(Killed):
        Training(tmp_path, (SELDOM, *OPTIONS), (STEP, 4))
    assert_same(Training(tmp_path, (SELDOM, *OPTIONS)), undisturbed["options"])


def test_weights_are_averaged_and_statistics_are_those_of_the_last_step(
    inside: Path, undisturbed: dict[str, Training], tmp_path: Path
) -> None:
    averaged = Training(tmp_path, (SELDOM, "training.ema_decay=0.5")).weights
    plain = undisturbed["plain"].weights
    names = [name for name in plain if name.endswith("running_mean")]
    assert all(torch.equal(averaged[name], plain[name]) for name in names)
    name = names[0].replace("running_mean", "weight")
    assert not torch.equal(averaged[name], plain[name])


def test_a_request_to_terminate_is_obeyed_at_once(
    inside: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    handler = signal.getsignal(signal.SIGTERM)

    def terminate(watched: Watched, what: str, trainer: Trainer) -> None:
        if what == STEP:
            os.kill(os.getpid(), signal.SIGTERM)

    monkeypatch.setattr(Watched, "die_if_due", terminate)
    with pytest.raises(KeyboardInterrupt):
        Training(tmp_path, (ALWAYS,))
    assert not (tmp_path / "last.ckpt").exists()
    assert not (tmp_path / "model.ckpt").exists()
    assert signal.getsignal(signal.SIGTERM) == handler


def start_stage(project: Path, *overrides: str) -> subprocess.Popen[str]:
    """The stage's script, as DVC runs it."""
    environment = os.environ | {"PYTHONPATH": str(ROOT / "src")}
    environment.pop("MLFLOW_TRACKING_URI", None)
    return subprocess.Popen(
        [sys.executable, str(ROOT / "pipelines/train.py"), "out=models/d", *SIZES, *overrides],
        cwd=project, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip


def kill_when(process: subprocess.Popen[str], written: str, project: Path) -> Path:
    """Kill a process as soon as a file matches the pattern; return the file."""
    while not (found := list(project.glob(written))):
        assert process.poll() is None, process.communicate()[0]
        time.sleep(0.01)
    process.kill()
    process.wait()
    return found[0]


def validations(rows: list[tuple[int, str, float]]) -> list[tuple[int, str, float]]:
    return [row for row in rows if row[1].startswith("validation/")]


def test_the_stage_goes_on_after_sigkill(
    project: Path, undisturbed: dict[str, Training], inside: Path
) -> None:
    last = kill_when(start_stage(project), "data/scratch/training/*/last.ckpt", project)
    assert not (project / "models/d/model.ckpt").exists()
    # Settings that do not determine the training may change before it resumes, even if MLflow logs
    # them: the images are now read by a separate process, as by default.
    process = start_stage(project, SELDOM, "training.loader_workers=1")
    output, _ = process.communicate()
    assert process.returncode == 0, output
    assert f"resuming at step 3 from {last.relative_to(project)}" in output
    assert "not resumable" not in output
    assert not last.exists()
    checkpoint = torch.load(project / "models/d/model.ckpt", weights_only=True)
    for name, value in undisturbed["plain"].weights.items():
        assert torch.equal(checkpoint["state_dict"][f"network.{name}"], value), name
    rows = read_curves(project / "models/d/curves.csv")
    assert validations(rows) == validations(undisturbed["plain"].curves.rows)
    mlflow.set_tracking_uri(f"sqlite:///{project / 'mlflow.db'}")
    (run,) = mlflow.search_runs(experiment_names=["shaftpose"], output_format="list")
    assert run.info.status == "FINISHED"
    history = mlflow.MlflowClient().get_metric_history(run.info.run_id, "validation/mAP")
    assert {point.step for point in history} == {2, 4}
